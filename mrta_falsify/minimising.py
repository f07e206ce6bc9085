"""The smallest world that still fails in the same way.

Hierarchical delta debugging on the World: the horizon and the tasks behind the violation first,
since they make every later run short; then people, furniture, events, robots and tasks, each
group all at once, then by halves down to single things (Zeller and Hildebrandt's ddmin); at last
values are moved to nominal. What is left is 1-minimal: no single thing can go. Every accepted
step is a run that failed with the same signature, so the result is verified by construction.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from mrta_falsify.campaign.signature import leading, signature
from mrta_falsify.campaign.store import Campaign, write_atomically
from mrta_falsify.campaigns import stored_world
from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import CommsOutage, World, write_world
from mrta_falsify.trial import Job, Judged, campaign_specifications, judge, quick_stack
from simulator_interface import starts

#: groups of things, in the order in which they are tried
GROUPS = ("humans", "furniture", "events", "robots", "tasks")
MARGIN = 15.0  # s of horizon behind the violation
CACHE = "minimize.cache.jsonl"  # answers so far, so that a second call goes on


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Minimised:
    """The result."""

    world: World
    judged: Judged  #: its run
    signature: str
    removed: tuple[str, ...]  #: in words
    runs: int  #: simulated for it, those of earlier attempts included
    one_minimal: bool  #: False if the runs did not suffice
    counts: dict[str, tuple[int, int]]  #: by group: before, after


@dataclass(slots=True)
class _Oracle:
    """Answers whether a world still fails in the same way; remembers answers, also on disc."""

    job: Job
    wanted: str
    max_runs: int
    cache: Path | None
    on_run: Callable[[int, str], None]
    runs: int = 0
    known: dict[str, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.cache is not None and self.cache.is_file():
            for line in self.cache.read_text(encoding="utf-8").splitlines():
                try:
                    row = json.loads(line)
                    self.known[str(row["world"])] = bool(row["fails"])
                except (ValueError, KeyError, TypeError):
                    continue  # a torn line costs one run
            self.runs = len(self.known)

    def fails(self, world: World, what: str) -> bool:
        """Whether ``world`` fails with the wanted signature; False once the runs are used up."""
        digest = world.digest()
        if digest in self.known:
            return self.known[digest]
        if self.runs >= self.max_runs:
            raise _OutOfRunsError
        try:
            starts.check_starts(world)
            judged = judge(dataclasses.replace(self.job, world=world), keep_trace=False)
            answer = signature(judged.verdicts) == self.wanted
        except InputError:
            answer = False  # no valid world
        self.runs += 1
        self.known[digest] = answer
        if self.cache is not None:
            with self.cache.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"world": digest, "fails": answer}) + "\n")
                file.flush()
                os.fsync(file.fileno())
        self.on_run(self.runs, f"{'fails' if answer else 'passes'} without {what}")
        return answer


class _OutOfRunsError(Exception):
    """The budget is used up."""


def minimise(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = 100,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Minimised:
    """Minimise a stored failure and keep the result beside it; a second call goes on.

    Args:
        campaign: it belongs to.
        record: of the failure.
        max_runs: simulations at most, those of earlier calls included.
        on_run: called after each with the number so far and a line about it.

    Returns:
        The result, written as ``world.min.json``, ``world.min.scenic``, ``trace.min.zip`` and
        ``minimize.json``, with the stack that it fails on as ``stack.yaml``.

    Raises:
        InputError: the trial did not fail, or its world is missing.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; there is nothing to minimise")
    settings = campaign.settings.trials
    config = settings.stack
    if record.engine != config.engine.name:
        config = quick_stack(config)
    job = Job(
        world=stored_world(campaign, record),
        config=config,
        specifications=settings.specifications or campaign_specifications(),
        early_stop=True,
    )
    folder = campaign.folder(record)
    folder.mkdir(parents=True, exist_ok=True)
    found = minimise_job(job, max_runs=max_runs, cache=folder / CACHE, on_run=on_run)
    write_world(found.world, folder / "world.min.json")
    write_trace(found.judged.outcome.trace, folder / "trace.min.zip")
    stack = yaml.safe_dump(codec.encode(config), sort_keys=False)
    write_atomically(folder / "stack.yaml", stack.encode())
    data = {**summary(found), "program": write_as_program(found, job, folder)}
    write_atomically(folder / "minimize.json", (json.dumps(data) + "\n").encode())
    return found


def write_as_program(found: Minimised, job: Job, folder: Path) -> str:
    """Write a minimised world as ``world.min.scenic`` and run what the program gives.

    Args:
        found: the result.
        job: that was minimised; its stack and specifications are used.
        folder: for the program, and its layout ``world.min.layout.json`` if no shipped one.

    Returns:
        ``identical`` if the program's run has the same trace, ``same failure`` if it has the
        same signature, else why there is no program; then none is left in ``folder``.
    """
    from scenic_worlds.program import compile_program  # noqa: PLC0415 - Scenic takes seconds
    from scenic_worlds.writing import write_program  # noqa: PLC0415

    path = folder / "world.min.scenic"
    why = f"The smallest world that fails with {found.signature}."
    files: tuple[Path, ...] = (path, path.with_suffix(".layout.json"))
    try:
        write_program(found.world, path, comment=why)
        judged = judge(dataclasses.replace(job, world=compile_program(path).sample(0)))
        if judged.outcome.trace.digest == found.judged.outcome.trace.digest:
            return "identical"
        if signature(judged.verdicts) == found.signature:
            return "same failure"
        reason = f"the program's world gives {signature(judged.verdicts) or 'no failure'}"
    except InputError as error:
        reason = str(error)
    for file in files:
        file.unlink(missing_ok=True)
    return reason


def summary(found: Minimised) -> dict[str, Any]:
    """The result as JSON-shaped data."""
    return {
        "signature": found.signature,
        "removed": list(found.removed),
        "runs": found.runs,
        "one_minimal": found.one_minimal,
        "counts": {name: list(pair) for name, pair in found.counts.items()},
        "share_removed": share_removed(found),
        "world_digest": found.world.digest(),
        "trace_digest": found.judged.outcome.trace.digest,
        "verdicts": [codec.encode(v) for v in found.judged.verdicts if v.violated],
    }


def share_removed(found: Minimised) -> float:
    """Share of robots, people, furniture, tasks and events that could go."""
    before = sum(pair[0] for pair in found.counts.values())
    after = sum(pair[1] for pair in found.counts.values())
    return 1.0 - after / before if before else 0.0


def minimise_job(
    job: Job,
    *,
    max_runs: int = 100,
    cache: Path | None = None,
    on_run: Callable[[int, str], None] = lambda runs, text: None,
) -> Minimised:
    """Minimise the failure of a job (see :func:`minimise`)."""
    first = judge(job, keep_trace=False)
    verdict = leading(first.verdicts)
    if verdict is None:
        raise InputError("the run violates nothing; there is nothing to minimise")
    oracle = _Oracle(job, signature(first.verdicts), max_runs, cache, on_run)
    search = _Search(job.world, oracle)
    complete = True
    try:
        search.cut_time(verdict)
        search.remove_all_that_can_go()
        search.move_to_nominal()
    except _OutOfRunsError:
        complete = False
    judged = judge(dataclasses.replace(job, world=search.world))
    return Minimised(
        world=search.world,
        judged=judged,
        signature=oracle.wanted,
        removed=_removed(job.world, search.world),
        runs=oracle.runs,
        one_minimal=complete,
        counts={g: (len(getattr(job.world, g)), len(getattr(search.world, g))) for g in GROUPS},
    )


class _Search:
    """Holds the smallest failing world so far."""

    def __init__(self, world: World, oracle: _Oracle) -> None:
        self.world = world
        self._oracle = oracle

    def _try(self, world: World, what: str) -> bool:
        if not self._oracle.fails(world, what):
            return False
        self.world = world
        return True

    def cut_time(self, verdict: Verdict) -> None:
        """Tasks that arrive after the violation, and the time behind it."""
        if verdict.violated_at is None or verdict.spec == "all_tasks_done":
            return
        found = verdict.violated_at
        tasks = tuple(task for task in self.world.tasks if task.arrival <= found)
        horizon = min(self.world.horizon, found + MARGIN)
        self._try(
            dataclasses.replace(self.world, tasks=tasks, horizon=horizon),
            "what comes after the violation",
        )

    def remove_all_that_can_go(self) -> None:
        """Pass over all groups until nothing goes any more: then each single thing is needed."""
        while True:
            before = self.world
            for group in GROUPS:
                self._shrink(group)
            if self.world is before:
                return

    def _shrink(self, group: str) -> None:
        """ddmin: chunks from the whole group down to single things."""
        size = len(getattr(self.world, group))
        while size >= 1:
            start = 0
            while start < len(getattr(self.world, group)):
                items = getattr(self.world, group)
                kept = items[:start] + items[start + size :]
                gone = items[start : start + size]
                # without robots or without tasks nothing can fail
                hopeless = group in ("robots", "tasks") and not kept
                if hopeless or not self._try(_with(self.world, group, kept), _named(group, gone)):
                    start += size
            if size == 1:
                return
            size = min(size // 2, max(len(getattr(self.world, group)), 1))

    def move_to_nominal(self) -> None:
        """Noise, delays, odd speeds and times, as far as the failure does not need them."""
        for what, change in NOMINAL:
            changed = change(self.world)
            if changed.digest() != self.world.digest():
                self._try(changed, what)


def _with(world: World, group: str, items: Sequence[Any]) -> World:
    """``world`` with another tuple of one group; outages forget robots that are gone."""
    changes: dict[str, Any] = {group: tuple(items)}
    if group == "robots":
        names = {robot.name for robot in items}
        changes["events"] = tuple(
            dataclasses.replace(event, robots=tuple(n for n in event.robots if n in names))
            if isinstance(event, CommsOutage) and event.robots
            else event
            for event in world.events
            if not isinstance(event, CommsOutage) or not event.robots or names & set(event.robots)
        )
    return dataclasses.replace(world, **changes)


def _named(group: str, items: Sequence[Any]) -> str:
    if group == "tasks":
        return f"{len(items)} tasks" if len(items) > 1 else "a task"
    if len(items) == 1:
        return str(items[0].name)
    return f"{len(items)} {group}"


def _calm_robots(world: World) -> World:
    quiet: dict[str, Any] = {
        "position_noise": 0.0,
        "heading_noise": 0.0,
        "wheel_slip": 0.0,
        "command_latency": 0.0,
        "joins_at": 0.0,
    }
    return dataclasses.replace(
        world, robots=tuple(dataclasses.replace(robot, **quiet) for robot in world.robots)
    )


def _calm_people(world: World) -> World:
    humans = tuple(dataclasses.replace(human, speed=1.0) for human in world.humans if human.speed)
    still = tuple(human for human in world.humans if not human.speed)
    return dataclasses.replace(world, humans=humans + still)


def _no_service(world: World) -> World:
    return dataclasses.replace(
        world,
        tasks=tuple(
            dataclasses.replace(task, pickup_time=0.0, dropoff_time=0.0) for task in world.tasks
        ),
    )


def _all_at_once(world: World) -> World:
    return dataclasses.replace(
        world, tasks=tuple(dataclasses.replace(task, arrival=0.0) for task in world.tasks)
    )


#: what it is called, and the change
NOMINAL: tuple[tuple[str, Callable[[World], World]], ...] = (
    ("noise and delays of robots", _calm_robots),
    ("noise of obstacle distances", lambda world: dataclasses.replace(world, ray_noise=0.0)),
    ("service times", _no_service),
    ("different paces of people", _calm_people),
    ("different arrivals of tasks", _all_at_once),
)


def _removed(before: World, after: World) -> tuple[str, ...]:
    """What is gone, in words."""
    texts = []
    for group in GROUPS:
        one, other = len(getattr(before, group)), len(getattr(after, group))
        if one > other:
            texts.append(f"{one - other} of {one} {group}")
    if after.horizon < before.horizon:
        texts.append(f"everything after {after.horizon:.0f} s")
    for what, change in NOMINAL:
        had = change(before).digest() != before.digest()
        if had and change(after).digest() == after.digest():
            texts.append(what)
    return tuple(texts)
