"""Check Scenic programs: compile them, sample them, say who rejects scenes, lint them."""

from __future__ import annotations

import functools
import json
import statistics
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.settings import DEFAULTS, Mode
from mrta_falsify.commands.crowd_cost import cost_of
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.programs import (
    MAX_ATTEMPTS,
    Drawn,
    Params,
    draw_candidates,
    open_scenario,
)
from mrta_falsify.core import codec
from mrta_falsify.core.codec import later
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.tight_ways import TightCount, counted
from mrta_falsify.core.world import World

if TYPE_CHECKING:
    from mrta_falsify.core.candidate import Dimension, SearchSpace
    from mrta_falsify.possibility import Possibility
    from scenic_worlds.lint import Lint
    from scenic_worlds.program import Program

SHEET_WORLDS = 24  # worlds on a contact sheet at most


@dataclass(frozen=True, slots=True, kw_only=True)
class ImpossibleWorld:
    """A sampled world that no stack can do."""

    number: int  #: of the candidate
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckPush:
    """A sampled world in which furniture does not fit to where it is to be pushed."""

    number: int  #: of the candidate
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class OutsideRegion:
    """A thing that lies outside its region in some draws, before they are repaired."""

    name: str
    draws: int  #: in which it is outside
    of: int  #: draws
    region: str  #: that should contain it; empty: it has no name
    placed: str  #: that its position is drawn from; empty: none that has a name
    where: str  #: ``file:line`` that makes it

    @property
    def advice(self) -> str:
        """What to change."""
        if self.region in ("standing_room", "clear_of_doors"):
            part = f"in {self.placed or 'REGION'}.intersect({self.region})"
            return (
                f"place it {part}, make it smaller, or let it stand in doorways and on waiting "
                "spots, too, by `with regionContainedIn free_floor`"
            )
        if self.region == "free_floor":
            return "place it farther from walls, or make it smaller"
        return "place it in a part of its region, make it smaller, or give `regionContainedIn`"


@dataclass(frozen=True, kw_only=True, eq=False)
class ProgramCheck:
    """What is known of a program after it was compiled and sampled."""

    scenario: str
    path: Path
    mode: Mode
    space: SearchSpace
    compile_s: float
    drawn: tuple[Drawn, ...]
    outside: tuple[OutsideRegion, ...]
    lint: tuple[Lint, ...]

    @property
    def worlds(self) -> tuple[World, ...]:
        """The sampled worlds, in order."""
        return tuple(item.world for item in self.drawn if item.world is not None)

    @functools.cached_property
    def possible(self) -> dict[int, Possibility]:
        """What no stack can do in each sampled world, by its number.

        The default specifications of a campaign are asked for.
        """
        from mrta_falsify.possibility import look_at  # noqa: PLC0415 - loads the engines
        from mrta_falsify.trial import campaign_specifications  # noqa: PLC0415

        specifications = campaign_specifications()
        return {
            item.number: look_at(item.world, specifications)
            for item in self.drawn
            if item.world is not None
        }

    @property
    def crowd(self) -> str:
        """What the dearest of the sampled worlds costs, empty if none is a crowd."""
        costs = [cost_of(world, StackConfig()) for world in self.worlds]
        dearest = max(costs, key=lambda cost: cost.total_s, default=None)
        return str(dearest) if dearest is not None and dearest.is_crowd else ""

    @property
    def impossible(self) -> tuple[ImpossibleWorld, ...]:
        """The sampled worlds that no stack can do."""
        return tuple(
            ImpossibleWorld(number=number, reason=found.reason)
            for number, found in self.possible.items()
            if found.reason
        )

    @property
    def acceptance(self) -> float:
        """Share of uniform samples that are valid as they are.

        In mode exact all attempts are uniform samples; in mode repair the first of each
        candidate is.
        """
        if self.mode == "exact":
            return len(self.worlds) / sum(item.attempts for item in self.drawn)
        return sum(item.attempts == 1 and not item.error for item in self.drawn) / len(self.drawn)

    @property
    def rejections(self) -> list[tuple[str, int]]:
        """Who rejected how often, most frequent first."""
        counts: Counter[str] = Counter()
        for item in self.drawn:
            counts.update(item.rejections)
        return sorted(counts.items(), key=lambda entry: (-entry[1], entry[0]))


def check(
    scenario: Place,
    output: Place | None = None,
    *,
    count: int = 20,
    seed: int = DEFAULTS.trials.seed,
    params: Params = (),
    mode: Mode = DEFAULTS.trials.mode,
    max_attempts: int = MAX_ATTEMPTS,
    on_progress: Callable[[float], None] = lambda done: None,
) -> ProgramCheck:
    """Compile a program, sample it and lint it.

    Args:
        scenario: path or shipped name.
        output: directory for the files of :func:`write_check`; none are written if None.
        count: scenes to sample.
        seed: of the campaign whose candidates are taken.
        params: Scenic's global parameters to override.
        mode: how scenes are accepted.
        max_attempts: scenes to try for each.
        on_progress: called with the number of scenes done.

    Raises:
        InputError: anything is wrong with the program; says what and where.
    """
    from scenic_worlds import lint  # noqa: PLC0415 - loads Scenic, which is not compiling

    began = time.perf_counter()
    program = open_scenario(scenario, params)
    compile_s = time.perf_counter() - began
    drawn = []
    candidates = draw_candidates(
        program, count=count, seed=seed, mode=mode, max_attempts=max_attempts
    )
    for item in candidates:
        drawn.append(item)
        on_progress(len(drawn))
    done = ProgramCheck(
        scenario=program.name,
        path=program.path,
        mode=mode,
        space=program.space,
        compile_s=compile_s,
        drawn=tuple(drawn),
        outside=_outside_regions(program, count, seed),
        lint=lint.lint_program(program.scenario, program.path, program.space),
    )
    if output is not None:
        write_check(done, output)
    return done


def _outside_regions(program: Program, count: int, seed: int) -> tuple[OutsideRegion, ...]:
    """Count in how many of the first candidates each thing lies outside its region."""
    found = Counter(
        thing
        for number in range(count)
        for thing in program.outside(program.candidate(seed, number))
    )
    return tuple(
        OutsideRegion(
            name=thing.name,
            draws=draws,
            of=count,
            region=thing.region,
            placed=thing.placed,
            where=thing.where,
        )
        for thing, draws in sorted(found.items(), key=lambda entry: (-entry[1], entry[0].name))
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneTimes:
    """How long a scene takes [ms]."""

    median: float
    p90: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Rejecter:
    """What rejects scenes."""

    who: str
    count: int  #: scenes rejected


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckSummary:
    """What ``check --format json`` prints of a program."""

    scenario: str
    mode: Mode
    dimensions: tuple[Dimension, ...]
    k: int  #: number of dimensions
    opaque: tuple[str, ...]  #: names of dimensions that a search cannot steer smoothly
    compile_s: float
    scene_ms: SceneTimes
    acceptance: float  #: share of uniform samples that are valid as they are
    attempts: int  #: samples drawn for the scenes
    scenes: int  #: valid scenes
    failed: int  #: candidates without a valid scene
    rejections: tuple[Rejecter, ...]
    outside: tuple[OutsideRegion, ...]  #: things outside their region before repair
    impossible: tuple[ImpossibleWorld, ...]  #: sampled worlds that no stack can do
    shut: tuple[TightCount, ...]  #: worlds in which no robot fits to a room that a task needs
    narrow: tuple[TightCount, ...]  #: the same by the planning radius, which is larger
    stuck_pushes: tuple[StuckPush, ...]  #: furniture that does not fit to where it is to be pushed
    lint: tuple[Lint, ...]
    crowd: str = later("")  #: what the dearest world costs, if one is a crowd


def summarise_check(done: ProgramCheck) -> CheckSummary:
    """Sum a check up."""
    scenes = len(done.worlds)
    possible = done.possible
    times = [1e3 * item.seconds for item in done.drawn]
    return CheckSummary(
        scenario=done.scenario,
        mode=done.mode,
        dimensions=tuple(done.space.dimensions),
        k=len(done.space),
        opaque=tuple(d.name for d in done.space.dimensions if d.kind == "opaque"),
        compile_s=round(done.compile_s, 4),
        scene_ms=SceneTimes(
            median=round(statistics.median(times), 3), p90=round(_quantile(times, 0.9), 3)
        ),
        acceptance=round(done.acceptance, 6),
        attempts=sum(item.attempts for item in done.drawn),
        scenes=scenes,
        failed=len(done.drawn) - scenes,
        rejections=tuple(Rejecter(who=who, count=count) for who, count in done.rejections),
        outside=done.outside,
        impossible=done.impossible,
        shut=counted(found.shut for found in possible.values()),
        narrow=counted(found.narrow for found in possible.values()),
        stuck_pushes=tuple(
            StuckPush(number=number, text=text)
            for number, found in possible.items()
            for text in found.stuck_pushes
        ),
        lint=done.lint,
        crowd=done.crowd,
    )


def _quantile(values: Sequence[float], share: float) -> float:
    """Find the value that ``share`` of the values do not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def write_check(done: ProgramCheck, directory: Place) -> tuple[Path, ...]:
    """Write ``check.json`` and, if there are worlds, ``contact_sheet.png``.

    Raises:
        InputError: the directory cannot be made.
    """
    folder = make_directory(Path(directory))
    report = folder / "check.json"
    data = codec.finite(codec.encode(summarise_check(done)))
    write_atomically(report, (json.dumps(data, indent=1) + "\n").encode())
    if not done.worlds:
        return (report,)
    sheet = folder / "contact_sheet.png"
    _draw_worlds(done, sheet)
    return (report, sheet)


def _draw_worlds(done: ProgramCheck, path: Path) -> None:
    """Draw the first sampled worlds of a check."""
    from reports import contact_sheet  # noqa: PLC0415 - matplotlib loads slowly

    shown = [item for item in done.drawn if item.world is not None][:SHEET_WORLDS]
    contact_sheet.write_contact_sheet(
        [item.world for item in shown if item.world is not None],
        path,
        title=done.scenario,
        captions=[f"{item.number:03d}" for item in shown],
    )
