"""The report of a campaign: one HTML file that opens from disk and asks nobody for anything."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from PIL import Image

from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from reports import drawings, packing
from reports.figures import costmap_image
from reports.sentences import edge_sentence, sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterfactual:
    """What a re-run with one thing changed showed."""

    change: str  #: in words, for example "priority rule: distance_to_goal instead of fixed"
    failure_gone: bool
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """One failure as the report shows it."""

    id: str
    signature: str
    world: World
    trace: Trace
    verdicts: tuple[Verdict, ...]
    facts: tuple[tuple[str, str], ...]  #: label and text: digests, seeds, engine, versions
    commands: tuple[tuple[str, str], ...]  #: what it does, and the command
    costmap: Costmap | None = None  #: at time 0
    layer: str = ""  #: suspected
    counterfactuals: tuple[Counterfactual, ...] = ()
    identical: tuple[int, int] | None = None  #: replays with the same digest, of how many
    jittered: tuple[int, int] | None = None  #: failures among jittered copies, of how many
    removed: tuple[str, ...] = ()  #: by the minimiser, in words
    minimised: Case | None = None
    neighbours: tuple[str, ...] = ()  #: that pass, in words
    family: tuple[str, ...] = ()  #: conditions under which runs fail like this, in words
    family_precision: str = ""  #: how often they do, empty: nobody asked


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mode:
    """Failures with one signature; some of them in full."""

    signature: str
    ids: tuple[str, ...]
    cases: tuple[Case, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trials:
    """All judged trials of a campaign, in order."""

    numbers: tuple[int, ...]
    scores: tuple[float, ...]
    failed: tuple[bool, ...]
    places: np.ndarray  #: (n, 2) where each came closest to trouble [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Report:
    """Everything the page of a campaign says."""

    title: str
    headline: str
    facts: tuple[tuple[str, str], ...]
    modes: tuple[Mode, ...]
    trials: Trials
    errors: tuple[tuple[str, str], ...] = ()  #: id and what the toolkit failed at
    floor: World | None = None  #: whose floor the coverage map shows
    stack: str = ""  #: YAML
    versions: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()  #: what the numbers do not say
    tables: tuple[Table, ...] = ()  #: further tables


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table with a heading."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...] = field(default_factory=tuple)


def write_report(report: Report, path: Path) -> None:
    """Write the page.

    Args:
        report: what it says.
        path: the HTML file.
    """
    path.write_text(render(report), encoding="utf-8")


def render(report: Report) -> str:
    """The page as HTML text."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["sentence"] = sentence
    environment.filters["edge_sentence"] = edge_sentence
    trials = report.trials
    return environment.get_template("report.html").render(
        report=report,
        style=_own_text("report.css"),
        script=_own_text("replay.js") if any(mode.cases for mode in report.modes) else "",
        scores=drawings.scores(trials.numbers, trials.scores, trials.failed)
        if trials.numbers
        else "",
        coverage=drawings.coverage(report.floor, trials.places, trials.failed)
        if report.floor is not None and trials.numbers
        else "",
        draw=draw_case,
    )


def _own_text(name: str) -> Markup:
    """A file of our own templates, to be put into the page as it is."""
    return Markup((Path(__file__).parent / "templates" / name).read_text(encoding="utf-8"))


def draw_case(case: Case) -> dict[str, Any]:
    """Drawings and data of a case, by name, for the template."""
    violated = [verdict for verdict in case.verdicts if verdict.violated]
    edges, members = cycle_of(violated)
    found = min((v.violated_at for v in violated if v.violated_at is not None), default=0.0)
    onset = next(
        (v.evidence["onset"] for v in violated if isinstance(v.evidence.get("onset"), float)), found
    )
    who = members or [name for v in violated[:1] for name in v.who if name in case.trace.robots]
    return {
        "violated": violated,
        "edges": edges,
        "members": members,
        "data": Markup(packing.pack(case.world, case.trace, case.verdicts)),
        "begin": max(0.0, onset - 10.0),
        "jumps": _jumps(onset, found, bool(members), case.trace.duration),
        "place": place_of(violated, case, who),
        "graph": drawings.wait_for_graph(edges, case.world) if edges else "",
        "moment": drawings.moment(case.world, case.trace, found, edges, members=who),
        "timelines": drawings.timelines(case.world, case.trace, [(found, "found")]),
        "signals": drawings.signals(case.trace, violated, who),
        "costmap": costmap_picture(case.costmap) if case.costmap is not None else None,
    }


def _jumps(onset: float, found: float, deadlock: bool, end: float) -> list[tuple[str, float]]:
    jumps = [("start", 0.0)]
    if deadlock:
        jumps += [("before onset", max(0.0, onset - 10.0)), ("onset", onset)]
    return [*jumps, ("found", found), ("end", end)]


def cycle_of(violated: Sequence[Verdict]) -> tuple[list[dict[str, str]], list[str]]:
    """Edges and members of the deadlock among ``violated``, empty if there is none."""
    for verdict in violated:
        if verdict.spec == "no_deadlock":
            return list(verdict.evidence.get("cycle", [])), list(verdict.who)
    return [], []


def place_of(violated: Sequence[Verdict], case: Case, who: Sequence[str]) -> str:
    """``x,y`` [m] of a close-up, empty if nothing has a place."""
    for verdict in violated:
        place = verdict.evidence.get("place")
        if isinstance(place, dict) and "x" in place:
            return f"{float(place['x']):.2f},{float(place['y']):.2f}"
    if not who:
        return ""
    number = case.trace.robots.index(who[0])
    found = violated[0].violated_at if violated else None
    tick = len(case.trace) - 1 if found is None else round(found / case.trace.dt)
    x, y = case.trace.columns["pose"][min(tick, len(case.trace) - 1), number, :2]
    return f"{x:.2f},{y:.2f}"


def costmap_picture(costmap: Costmap) -> dict[str, str]:
    """The costmap as a PNG data address, with its extent in the map frame [m]."""
    image = Image.fromarray(costmap_image(costmap)[::-1]).quantize(64)
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    rows, cols = costmap.cost.shape
    x, y = (float(value) for value in costmap.origin)
    extent = (x, y, x + cols * costmap.resolution, y + rows * costmap.resolution)
    return {
        "uri": "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode(),
        "extent": ",".join(f"{value:.3f}" for value in extent),
    }
