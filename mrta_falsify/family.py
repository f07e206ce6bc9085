"""From one failure to a rule: a box over named dimensions in which runs fail in the same way.

Three steps, each bounded in runs. First, which dimensions matter: groups of them are let go over
their whole range while the others stay as in the failure; a group whose runs keep failing with
the same signature does not matter, any other one is halved (delta debugging over dimensions).
Second, how far those that matter may move: neighbours at several distances are run, and a box
around the failure is peeled until runs in it fail (the Patient Rule Induction Method of Friedman
and Fisher, "Bump hunting in high-dimensional data", Statistics and Computing 9, 1999, with the
failure always inside). Choices that matter stay as they are. Third, the box is written as a
Scenic program, and that program is sampled anew, with points that nothing was learned from, to
measure how often it fails.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mrta_falsify.campaign.settings import TrialSettings
from mrta_falsify.campaign.signature import signature
from mrta_falsify.campaign.statistics import Probability, failure_probability
from mrta_falsify.campaign.store import Campaign, write_atomically
from mrta_falsify.campaigns import stored_world
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.candidate import Candidate, Dimension
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.seeding import candidate_seed, stream
from mrta_falsify.trial import Job, campaign_specifications, judge, open_program, quick_stack

if TYPE_CHECKING:
    from scenic_worlds.program import Program

DISTANCES = (0.02, 0.05, 0.1, 0.2, 0.4)  # shares of a dimension's range, of neighbours
REPEATS = 4  # runs that must all fail before dimensions count as free
ROUNDS = 3  # of neighbours, each around the box of the round before
PURE = 0.95  # share of failures in a box at which peeling stops
PEEL = 0.1  # share of a box's points that one cut removes
FEWEST = 6  # points in a box below which nothing is cut any more
SCENES = 300  # attempts at a valid scene before a point is given up
GRADED = ("range", "normal", "point")  # kinds of dimensions of which near values mean something

Fate = Literal["interval", "held", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """What the rule says about one dimension."""

    dimension: str
    fate: Fate  #: unknown: held too, because the runs did not suffice to try it
    low: float  #: shares of the dimension's range
    high: float
    text: str  #: in the program's units


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """A failure's family."""

    signature: str
    engine: str  #: of all runs
    conditions: tuple[Condition, ...]
    free: tuple[str, ...]  #: dimensions that do not matter
    noise_seed: int | None  #: fixed because other noise cures the failure
    precision: Probability  #: on fresh samples of the written program
    elsewhere: tuple[int, int]  #: trials of the campaign with the signature, of how many judged
    learning_runs: int
    no_scene: int  #: fresh samples for which no valid scene was found
    program: str = ""  #: path of the Scenic program


def find_family(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = 300,
    fresh: int = 100,
    path: Path | None = None,
    on_run: Callable[[int], None] = lambda runs: None,
) -> Family:
    """Find the family of a stored failure and keep it beside the trial.

    Args:
        campaign: it belongs to.
        record: of the failure.
        max_runs: simulations at most; those of the fresh samples included.
        fresh: samples on which the precision is measured; at most half of ``max_runs``.
        path: of the Scenic program; ``family.scenic`` beside the trial if None.
        on_run: called after each run with their number.

    Returns:
        The family, written as ``family.json`` and as a Scenic program.

    Raises:
        InputError: the trial did not fail, nothing of its program is random, or the program
            cannot be moved to where the family is to be written.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; it has no failure family")
    settings = campaign.settings.trials
    program = open_program(settings)
    if not len(program.space):
        raise InputError(f"{settings.scenario}: nothing in it is random; a family needs dimensions")
    folder = campaign.folder(record)
    folder.mkdir(parents=True, exist_ok=True)
    path = path or folder / "family.scenic"
    _check_can_move(program.path, path)
    runs = _Runs(settings, program, *_reference(campaign, record), max_runs, on_run)
    fresh = max(1, min(fresh, max_runs // 2))
    search = _Search(runs, record.candidate, budget=max_runs - fresh)
    search.learn()
    conditions = search.conditions()
    noise_seed = None if search.fresh_noise else record.candidate.seed
    found = Family(
        signature=runs.wanted,
        engine=runs.config.engine.name,
        conditions=conditions,
        free=tuple(program.space.dimensions[i].name for i in search.free),
        noise_seed=noise_seed,
        precision=failure_probability(0, 0),
        elsewhere=_share_elsewhere(campaign, record),
        learning_runs=runs.count,
        no_scene=0,
        program=str(path),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, program_text(found, program, record, campaign).encode())
    precision, no_scene = _measure(found, runs, record, fresh)
    found = dataclasses.replace(found, precision=precision, no_scene=no_scene)
    # once more, since the program says what was measured
    write_atomically(path, program_text(found, program, record, campaign).encode())
    text = json.dumps(summary(found), indent=1) + "\n"
    write_atomically(folder / "family.json", text.encode())
    return found


def _check_can_move(source: Path, target: Path) -> None:
    """Refuse to write a program that would not find its own files any more.

    Raises:
        InputError: it uses files beside it, and the copy would lie elsewhere; or the copy would
            replace it.
    """
    from scenic_worlds.sources import source_files  # noqa: PLC0415 - Scenic takes seconds

    if source.resolve() == target.resolve():
        raise InputError(f"{target}: is the program itself; give another file by -o")
    beside = source.resolve().parent
    if target.resolve().parent == beside:
        return
    others = [f for f in source_files(source) if f.parent == beside and f != source.resolve()]
    if others or "localPath" in source.read_text(encoding="utf-8"):
        raise InputError(
            f"{source}: uses files beside it, so its family must lie there too; give "
            f"-o {source.with_name('family.scenic')}"
        )


def _reference(campaign: Campaign, record: TrialRecord) -> tuple[StackConfig, str]:
    """Stack to run the family on, and the signature there: the quick engine if it agrees."""
    settings = campaign.settings.trials
    quick = quick_stack(settings.stack)
    world = stored_world(campaign, record)
    if record.engine == quick.engine.name:
        return quick, record.signature
    if not world.scripted:
        job = Job(
            world=world, config=quick, specifications=_specifications(settings), early_stop=True
        )
        if signature(judge(job, keep_trace=False).verdicts) == record.signature:
            return quick, record.signature
    return settings.stack, record.signature


def _specifications(settings: TrialSettings) -> tuple[str, ...]:
    return settings.specifications or campaign_specifications()


def _share_elsewhere(campaign: Campaign, record: TrialRecord) -> tuple[int, int]:
    judged = [other for other in campaign.records if other.status == "ok"]
    return sum(other.signature == record.signature for other in judged), len(judged)


# --- runs ------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Runs:
    """Runs points of a program and says whether they fail in the wanted way."""

    settings: TrialSettings
    program: Program
    config: StackConfig
    wanted: str
    max_runs: int
    on_run: Callable[[int], None]
    count: int = 0

    def fails(self, program: Program, candidate: Candidate) -> tuple[Array, bool] | None:
        """The point that was run and whether it failed; None: there is no valid scene.

        Args:
            program: this one or a restriction of it.
            candidate: of ``program``.
        """
        try:
            realised = program.realise(candidate, max_attempts=SCENES)
        except InputError:
            return None
        job = Job(
            world=realised.world,
            config=self.config,
            specifications=_specifications(self.settings),
            early_stop=True,
            scene=realised.scene,
        )
        self.count += 1
        try:
            failed = signature(judge(job, keep_trace=False).verdicts) == self.wanted
        except InputError:
            failed = False  # a world in which the stack cannot begin
        self.on_run(self.count)
        return realised.candidate.u, failed


def _measure(
    found: Family, runs: _Runs, record: TrialRecord, fresh: int
) -> tuple[Probability, int]:
    """How often the written program fails, and samples without a valid scene."""
    from scenic_worlds.program import compile_program  # noqa: PLC0415 - Scenic takes seconds

    program = compile_program(Path(found.program), runs.settings.params)
    seed = record.candidate.seed % 2**31
    verdicts = []
    for number in range(fresh):
        candidate = program.candidate(seed, number)
        verdicts.append(runs.fails(program, candidate))
    decided = [verdict[1] for verdict in verdicts if verdict is not None]
    return failure_probability(sum(decided), len(decided)), fresh - len(decided)


# --- learning --------------------------------------------------------------------------------


@dataclass(slots=True)
class _Search:
    """Learns the box; points are shares of the dimensions' ranges."""

    runs: _Runs
    case: Candidate
    budget: int
    free: list[int] = field(default_factory=list)
    ruling: list[int] = field(default_factory=list)  #: tried, and they matter
    fresh_noise: bool = True
    box: dict[int, tuple[float, float]] = field(default_factory=dict)
    drawn: int = 0

    def learn(self) -> None:
        """Which dimensions matter, then how far they may move."""
        self.fresh_noise = self._all_fail([])
        share = 2 * self.budget // 3
        waiting = [list(range(len(self.case.u)))]
        while waiting and self.runs.count + REPEATS <= share:
            group = waiting.pop(0)
            if self._all_fail(group):
                self.free += group
            elif len(group) == 1:
                self.ruling += group
            else:
                half = len(group) // 2
                waiting += [group[:half], group[half:]]
        self.free.sort()
        self.ruling.sort()
        graded = [i for i in self.ruling if self._dimension(i).kind in GRADED]
        if graded:
            self._widen(graded)

    def _dimension(self, number: int) -> Dimension:
        return self.runs.program.space.dimensions[number]

    def _all_fail(self, group: Sequence[int]) -> bool:
        """Whether runs fail with ``group`` and what is free already anywhere in their range."""
        intervals = self._intervals(dict.fromkeys(group, (0.0, 1.0)))
        for _ in range(REPEATS):
            result = self._run(intervals)
            if result is None or not result[1]:
                return False
        return True

    def _intervals(self, moved: dict[int, tuple[float, float]]) -> dict[int, tuple[float, float]]:
        """Everything as in the failure but ``moved`` and what is free."""
        free = set(self.free)
        held = {i: (float(x), float(x)) for i, x in enumerate(self.case.u) if i not in free}
        return held | moved

    def _run(self, intervals: dict[int, tuple[float, float]]) -> tuple[Array, bool] | None:
        """A uniform point of a box, and whether it fails."""
        k, number = len(self.case.u), self.drawn
        self.drawn += 1
        program = self.runs.program
        program.restrict(intervals)
        seed = candidate_seed(self.case.seed % 2**31, number) if self.fresh_noise else None
        candidate = dataclasses.replace(
            self.case,
            number=number,
            u=stream(self.case.seed, f"family/{number}").random(k),
            seed=self.case.seed if seed is None else seed,
        )
        result = self.runs.fails(program, candidate)
        program.restrict({})
        if result is None:
            return None
        ends = np.array([intervals.get(i, (0.0, 1.0)) for i in range(k)])
        return ends[:, 0] + (ends[:, 1] - ends[:, 0]) * result[0], result[1]

    def _widen(self, graded: list[int]) -> None:
        """Neighbours at several distances, and the box that remains after peeling."""
        center = self.case.u[graded]
        points, failed = [center], [True]
        left = self.budget - self.runs.count
        box = np.stack([center, center], axis=1)
        for number in range(left):
            near = number % len(DISTANCES)
            if number < left // ROUNDS or number % 2:
                ends = np.clip(center[:, None] + DISTANCES[near] * np.array([-1.0, 1.0]), 0.0, 1.0)
            else:
                ends = box
            pairs = {i: (float(a), float(b)) for i, (a, b) in zip(graded, ends, strict=True)}
            result = self._run(self._intervals(pairs))
            if result is not None:
                points.append(result[0][graded])
                failed.append(result[1])
            if (number + 1) % max(left // ROUNDS, 1) == 0 or number + 1 == left:
                box = peeled_box(np.array(points), np.array(failed), center)
        self.box = {i: (float(a), float(b)) for i, (a, b) in zip(graded, box, strict=True)}

    def conditions(self) -> tuple[Condition, ...]:
        """The rule, in the order of the dimensions."""
        free = set(self.free)
        matter = [i for i in range(len(self.case.u)) if i not in free]
        ends = [self.box.get(i, (float(self.case.u[i]),) * 2) for i in matter]
        return tuple(
            Condition(
                dimension=self._dimension(i).name,
                fate="unknown" if i not in self.ruling else "interval" if high > low else "held",
                low=low,
                high=high,
                text=self._text(i, low, high),
            )
            for i, (low, high) in zip(matter, ends, strict=True)
        )

    def _text(self, number: int, low: float, high: float) -> str:
        """A condition in the program's units, at the other values of the failure."""
        dimension = self._dimension(number)
        values: list[float] = []
        for share in (low, high):
            u = np.array(self.case.u)
            u[number] = share
            (value,) = self.runs.program.values_at(u, [number])
            if value is None and dimension.low is not None and dimension.high is not None:
                value = dimension.low + share * (dimension.high - dimension.low)
            if value is None or dimension.kind == "opaque":
                return f"{dimension.name} as in the failure"
            values.append(value)
        if dimension.kind == "choice":
            return f"{dimension.name} is option {values[0] + 1:.0f} of {dimension.choices}"
        if low == high:
            return f"{dimension.name} = {values[0]:.4g}"
        return f"{dimension.name} from {min(values):.4g} to {max(values):.4g}"


def peeled_box(points: Array, failed: BoolArray, center: Array) -> Array:
    """Box around ``center`` in which points fail, by peeling.

    Begins with all points. Each cut takes away the outermost tenth on one side of one dimension,
    never the centre; the cut that leaves the largest share of failures is made, until 95 % fail,
    few points are left, or no cut raises the share. The ends are those of the failing points
    that remain, so the box claims nothing beyond where a failure was seen.

    Args:
        points: ``(n, d)``, the centre among them.
        failed: ``(n,)``.
        center: ``(d,)``, which fails.

    Returns:
        ``(d, 2)`` lower and upper ends.
    """
    inside = np.ones(len(points), dtype=np.bool_)
    while inside.sum() > FEWEST and failed[inside].mean() < PURE:
        cuts = [
            cut
            for d in range(points.shape[1])
            for cut in _cuts(points[:, d], inside, float(center[d]))
        ]
        shares = [(float(failed[cut].mean()), int(cut.sum())) for cut in cuts]
        if not shares or max(shares)[0] <= failed[inside].mean():
            break
        inside = cuts[shares.index(max(shares))]
    kept = points[inside & failed]
    ends: Array = np.stack([kept.min(axis=0), kept.max(axis=0)], axis=1)
    return ends


def _cuts(values: Array, inside: BoolArray, center: float) -> list[BoolArray]:
    """What stays inside after a cut from below and one from above, along one dimension."""
    count = max(1, int(PEEL * inside.sum()))
    order = np.sort(values[inside])
    cuts = [inside & (values > min(order[count - 1], np.nextafter(center, -np.inf)))]
    cuts.append(inside & (values < max(order[-count], np.nextafter(center, np.inf))))
    return [cut for cut in cuts if cut.sum() < inside.sum()]


# --- writing ---------------------------------------------------------------------------------


def summary(found: Family) -> dict[str, Any]:
    """The family as JSON-shaped data."""
    return {
        **dataclasses.asdict(found),
        "conditions": [dataclasses.asdict(condition) for condition in found.conditions],
        "free": list(found.free),
        "elsewhere": list(found.elsewhere),
        "sentence": sentence(found),
    }


def rule_lines(found: Family) -> list[str]:
    """The rule, a line for each condition."""
    lines = [
        c.text + (" (not tried: out of runs)" if c.fate == "unknown" else "")
        for c in found.conditions
    ]
    if found.noise_seed is not None:
        lines.append(f"the noise of seed {found.noise_seed}")
    return lines or ["anything the program gives"]


def sentence(found: Family) -> str:
    """How good the rule is."""
    measured = found.precision
    here, judged = found.elsewhere
    if not measured.trials:
        return "No fresh sample of the family had a valid scene."
    return (
        f"{measured.failures} of {measured.trials} fresh samples of the family fail with this "
        f"signature on the {found.engine} engine ({measured.level:.0%} interval "
        f"{measured.low:.2f} to {measured.high:.2f}); in the campaign it was {here} of {judged} "
        f"trials. {len(found.free)} dimensions do not matter, {len(found.conditions)} do."
    )


def program_text(found: Family, program: Program, record: TrialRecord, campaign: Campaign) -> str:
    """The original program, restricted to the family."""
    head = [
        f"Failure family of trial {record.id} of {campaign.directory.name}: {found.signature}",
        "",
        "Runs fail in this way when",
        *(f"  {line}" for line in rule_lines(found)),
        "",
    ]
    if found.precision.trials:
        head += [sentence(found), ""]
    if program.params:
        given = " ".join(f"-p {name}={value}" for name, value in sorted(program.params.items()))
        head += [f"Give the same parameters as the campaign: {given}", ""]
    head.append(f"{program.path.name} follows; its last lines restrict it to the family.")
    comments = "\n".join(f"# {line}".rstrip() for line in head)
    pairs = "".join(
        f"    {c.dimension!r}: ({c.low!r}, {c.high!r}),  # {c.text}\n" for c in found.conditions
    )
    body = program.path.read_text(encoding="utf-8").rstrip("\n")
    seed = "" if found.noise_seed is None else f"param noise_seed = {found.noise_seed}\n"
    restrict = "param restrict = {  # share of each dimension's range\n" + pairs + "}\n"
    return f"{comments}\n\n{body}\n\n{restrict}{seed}"
