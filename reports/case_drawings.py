"""Drawings and data of one run, ready for the page."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from PIL import Image

from mrta_falsify.core import task_history
from mrta_falsify.core.claims import leading_claim
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import WaitAccount, tick_of, wait_account
from mrta_falsify.specs.books import confirmed
from mrta_falsify.specs.causes import cause_begins
from reports import floor_drawings, packing, time_charts
from reports.colours import costmap_colours
from reports.contents import CaseContents
from reports.floor_scene import costmap_extent
from reports.timelines import draw_chances, draw_timelines
from reports.wait_graph_drawing import draw_wait_graph

COSTMAP_STEP = 21  # cost values that share a colour
COSTMAP_COLOURS = 13  # steps of inflation; with the three special values, four bits a cell
LEAD = 10.0  # s before the onset at which the replay begins


@dataclass(frozen=True, slots=True, kw_only=True)
class CostmapPicture:
    """A costmap as a picture of the page."""

    uri: str  #: data address of the PNG
    extent: str  #: x min, y min, x max, y max [m], map frame, comma separated


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """A button of the replay that goes to a moment."""

    label: str
    time: float  #: [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnRun:
    """Drawings and data of one run."""

    violated: tuple[Verdict, ...]
    account: WaitAccount  #: who waits for whom; empty if nothing is violated
    tasks: tuple[str, ...]  #: what became of the tasks that the verdict names
    replay: Markup  #: packed data of the replay
    begin: float  #: where the replay begins [s]
    jumps: tuple[Jump, ...]
    place: str  #: x,y [m] of a close-up; empty if nothing has a place
    close: bool  #: the replay of a large floor opens close up
    moment: Markup | None  #: the floor when the violation was found
    graph: Markup | None
    timelines: Markup
    chances: Markup | None  #: of failure, by the time from which the run is repeated
    signals: tuple[tuple[str, Markup], ...]  #: name and plot
    costmap: CostmapPicture | None
    other: DrawnRun | None  #: beside it: of the other stack, or of the nearest passing trial

    @property
    def size(self) -> int:
        """Bytes of the drawings and data, the other stack's included."""
        parts = [self.replay, self.moment or "", self.graph or "", self.timelines]
        parts.append(self.chances or "")
        parts += [plot for _, plot in self.signals]
        own = sum(map(len, parts)) + (len(self.costmap.uri) if self.costmap else 0)
        return own + (self.other.size if self.other is not None else 0)

    def runs(self) -> tuple[DrawnRun, ...]:
        """List it with the other stack's run."""
        return (self,) if self.other is None else (self, self.other)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnCase:
    """A case and its smallest world, drawn."""

    main: DrawnRun
    minimised: DrawnRun | None

    @property
    def size(self) -> int:
        """Bytes of the drawings and data."""
        return self.main.size + (self.minimised.size if self.minimised is not None else 0)


def moment_name(id: str) -> str:
    """Name the drawing of a case's moment in the page."""
    return "moment-" + re.sub(r"[^A-Za-z0-9_-]+", "-", id)


def draw_case(case: CaseContents) -> DrawnCase:
    """Draw a case and, if there is one, its smallest world."""
    smallest = case.minimised
    return DrawnCase(
        main=_draw_run(case), minimised=_draw_run(smallest) if smallest is not None else None
    )


def _draw_run(case: CaseContents, begin: float | None = None) -> DrawnRun:
    """Draw a run; its replay begins before the onset, or at ``begin`` [s]."""
    world, trace = case.world, case.trace
    beside = case.other or case.passing
    violated = tuple(verdict for verdict in case.verdicts if verdict.violated)
    account = wait_account(violated[0], trace) if violated else WaitAccount(waits=())
    concerned = [item.name for item in account.objects]
    times = _Times.of(violated, trace.duration)
    tasks = task_history.tasks_of(violated[0]) if violated else []
    told = confirmed(trace, world)
    named = [name for v in violated[:1] for name in v.who if name in trace.robots]
    in_picture = account.robots if account.members else ()
    who = list(account.members) or named or task_history.robots_of(tasks, trace)
    if begin is None:
        begin = max(0.0, times.onset - LEAD) if violated else 0.0
    return DrawnRun(
        violated=violated,
        account=account,
        tasks=tuple(task_history.stories(tasks, world, told)),
        replay=Markup(packing.pack(world, trace, case.verdicts, concerned=concerned)),
        begin=begin,
        jumps=times.jumps(deadlock=bool(account.members)),
        place=_close_up_place(case, violated, who),
        close=any("place" in verdict.evidence for verdict in violated[:1]),
        moment=floor_drawings.draw_moment(
            world,
            trace,
            times.found,
            account.arrows,
            members=in_picture or who,
            named=concerned,
            name=moment_name(case.id),
        )
        if times.found is not None
        else None,
        graph=draw_wait_graph(account, world) if account.arrows else None,
        timelines=draw_timelines(told, times.marks),
        chances=draw_chances(case.inevitability, trace.duration)
        if case.inevitability is not None
        else None,
        signals=tuple(time_charts.draw_signals(trace, violated, who)),
        costmap=encode_costmap(case.costmap) if case.costmap is not None else None,
        other=_draw_run(beside, begin) if beside is not None else None,
    )


@dataclass(frozen=True, slots=True)
class _Times:
    """Moments of a run that the page points to [s]."""

    onset: float
    found: float | None  #: None: nothing is violated
    end: float

    @classmethod
    def of(cls, violated: Sequence[Verdict], end: float) -> _Times:
        if not violated:
            return cls(0.0, None, end)
        found = violated[0].violated_at
        found = end if found is None else found
        return cls(min(cause_begins(violated[0]), found), found, end)

    @property
    def marks(self) -> list[tuple[float, str]]:
        if self.found is None:
            return []
        onset = [(self.onset, "onset")] if self.onset != self.found else []
        return [*onset, (self.found, "found")]

    def jumps(self, *, deadlock: bool) -> tuple[Jump, ...]:
        jumps = [Jump(label="start", time=0.0)]
        if deadlock:
            jumps.append(Jump(label="before onset", time=max(0.0, self.onset - LEAD)))
            jumps.append(Jump(label="onset", time=self.onset))
        if self.found is not None:
            jumps.append(Jump(label="found", time=self.found))
        return (*jumps, Jump(label="end", time=self.end))


def _close_up_place(case: CaseContents, violated: Sequence[Verdict], who: Sequence[str]) -> str:
    """Find the place of the violation, or of the first robot concerned, as ``x,y`` [m]."""
    for verdict in violated[:1]:
        place = leading_claim(verdict.evidence).get("place")
        if isinstance(place, dict) and "x" in place:
            return f"{float(place['x']):.2f},{float(place['y']):.2f}"
    if not who:
        return ""
    trace = case.trace
    tick = tick_of(violated[0], trace) if violated else len(trace) - 1
    robot = trace.robots.index(who[0])
    x, y = trace.columns["pose"][tick, robot, :2]
    return f"{x:.2f},{y:.2f}"


def encode_costmap(costmap: Costmap) -> CostmapPicture:
    """Encode a costmap as a PNG of four bits a cell."""
    last = COSTMAP_COLOURS - 1
    step = np.minimum(np.arange(256) // COSTMAP_STEP, last).astype(np.uint8)
    special = [INSCRIBED, LETHAL, UNKNOWN]
    step[special] = COSTMAP_COLOURS + np.arange(len(special))
    shown = [*range(0, COSTMAP_COLOURS * COSTMAP_STEP, COSTMAP_STEP), *special]
    image = Image.fromarray(step[costmap.cost][::-1], "P")
    image.putpalette(costmap_colours()[shown].tobytes())
    buffer = io.BytesIO()
    image.save(buffer, "PNG", bits=4)
    return CostmapPicture(
        uri="data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode(),
        extent=",".join(f"{value:.3f}" for value in costmap_extent(costmap)),
    )
