"""A log of a fleet as a scenario: who waited for whom, and the worlds near by."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrta_falsify.commands.floor_import import DEFAULT_RADIUS
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.incident.judging import Suspicion, suspicion_in
from mrta_falsify.commands.incident.legs import HALTS_WITHIN, Leg, legs_of
from mrta_falsify.commands.incident.logs import read_log
from mrta_falsify.commands.incident.scene import Scene, floor_of_log, scene_of, with_robots
from mrta_falsify.commands.stacks import Stack
from mrta_falsify.core.claims import claim_kind
from mrta_falsify.core.codec import later
from mrta_falsify.core.errors import ConfigError, FormatError, WorldError
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.core.words import listed
from mrta_falsify.core.world import World, write_world
from mrta_falsify.specs.causes import kind_of
from simulator_interface.formats.fleet_log import FleetLog, RobotLog

MAX_ROBOTS = 100
STOOD_FOR = 30.0  # s, from then on the oracle suspects robots that stand
PROGRAM_ENDING, WORLD_ENDING = ".scenic", ".world.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Confirmation:
    """What a stack did in the incident's world."""

    stack: str
    deadlock: bool  #: ``no_deadlock`` is violated, whatever the kind
    members: tuple[str, ...]  #: robots that stand
    same: bool  #: the robots that stand are among those of the log
    delivered: int
    tasks: int
    kind: str = later("")  #: deadlock, stuck or shut


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImportedLog:
    """What a log shows, and what was written."""

    scenario: Path
    world: Path  #: the incident itself
    robots: tuple[str, ...]
    duration_s: float
    has_map: bool  #: the floor is known, from the log or as given
    suspected: tuple[str, ...]  #: robots that waited for each other
    victims: tuple[str, ...]  #: robots that these held up
    waits: tuple[str, ...]  #: who waited for whom, one sentence each
    onset_s: float | None  #: when the last of them stopped
    until_s: float | None  #: when they were last seen so
    begin_s: float  #: when in the log the scenario begins
    tasks: int
    goals: tuple[str, ...]  #: how the goals are known
    #: what a stack does in the scenario; null: no stack was run
    confirmed: Confirmation | None = None
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()  #: why the log cannot rule a deadlock out
    begins_at: float | None = None  #: start of the log [s since 1970]; null where it has no date


def import_log(
    log: Place,
    output: Place,
    *,
    floor: Place | None = None,
    radius: float = DEFAULT_RADIUS,
    stack: Stack | None = None,
    settings: tuple[str, ...] = (),
) -> ImportedLog:
    """Say who waited for whom in a log, and write the worlds near by as a scenario.

    Args:
        log: a rosbag2 folder, a folder of bags of one run, a ``.mcap`` or ``.db3`` file, or a run
            of this toolkit.
        output: directory for NAME.scenic, NAME.layout.json and NAME.world.json.
        floor: layout of the log's building, instead of the log's map.
        radius: of the robots [m]; those of a run of this toolkit are known.
        stack: to run the incident on; None: nothing is run.
        settings: ``--set`` texts applied to the stack.

    Raises:
        InputError: the log is damaged or tells too little; nothing is written then.
    """
    from reports.sentences import account_sentences  # noqa: PLC0415 - costs an import
    from scenic_worlds.neighbourhood import write_neighbourhood  # noqa: PLC0415

    source = Path(log)
    record, run = read_log(source)
    if len(record.robots) > MAX_ROBOTS:
        raise FormatError(f"{source}: has {len(record.robots)} robots; at most {MAX_ROBOTS}")
    if settings and stack is None:
        raise ConfigError("--set changes a stack; name it by --stack (default: the shipped one)")
    name = _name_of(source)
    known = _floor(floor, run)
    legs, seen, scene = _understood(source, record, run, known, name=name, radius=radius)
    verdict = None if seen is None else seen.verdict
    account = None if verdict is None else wait_account(verdict)
    members = account.members if account else ()
    waits = account_sentences(account) if account else ()
    folder = make_directory(Path(output))
    program, world_file = folder / f"{name}{PROGRAM_ENDING}", folder / f"{name}{WORLD_ENDING}"
    comment = _comment(source, scene, members, waits)
    write_neighbourhood(scene.world, program, comment=comment)
    write_world(scene.world, world_file)
    return ImportedLog(
        scenario=program,
        world=world_file,
        robots=tuple(robot.name for robot in record.robots),
        duration_s=record.duration,
        has_map=known is not None or record.grid is not None,
        suspected=members,
        victims=account.victims if account else (),
        waits=waits,
        onset_s=account.onset if account else None,
        until_s=None if seen is None else seen.until,
        begin_s=scene.begin,
        tasks=len(scene.world.tasks),
        goals=tuple(map(_origins, record.robots, legs)),
        confirmed=None
        if stack is None
        else _confirmation(scene.world, stack, settings, set(members)),
        notes=(*record.notes, *_silent_note(record), *scene.notes, *_map_note(record, known)),
        doubts=() if members else _doubts(record, legs),
        begins_at=record.begins_at,
    )


def _name_of(source: Path) -> str:
    stem = source.resolve().parent.name if source.name == "trace.zip" else source.name
    for ending in (".mcap", ".db3"):
        stem = stem.removesuffix(ending)
    return re.sub(r"[^\w.-]", "_", stem) or "incident"


def _floor(given: Place | None, run: World | None) -> World | None:
    if given is None:
        return run
    if run is not None:
        raise ConfigError("--floor is for logs without a world; this run has its own")
    from scenic_worlds.layouts import load_layout  # noqa: PLC0415 - loads numba

    return load_layout(given)


def _understood(
    source: Path,
    record: FleetLog,
    run: World | None,
    known: World | None,
    *,
    name: str,
    radius: float,
) -> tuple[tuple[tuple[Leg, ...], ...], Suspicion | None, Scene]:
    """Find the legs, the suspicion and the world of a log."""
    try:
        floor = floor_of_log(record, known, name)
        legs = legs_of(record, floor)
        staged = run or with_robots(floor, record, radius=radius, at=0.0)
        seen = suspicion_in(record, legs, staged)
        if run is not None:
            return legs, seen, Scene(world=run, begin=0.0, notes=())
        account = None if seen is None else wait_account(seen.verdict)
        scene = scene_of(
            record,
            legs,
            floor,
            onset=account.onset if account else None,
            who=account.robots if account else (),
            radius=radius,
        )
    except (WorldError, FormatError) as error:
        raise WorldError(f"{source}: {error}") from None
    return legs, seen, scene


def _origins(robot: RobotLog, legs: tuple[Leg, ...]) -> str:
    kinds = dict.fromkeys(leg.origin for leg in legs)
    return f"{robot.name}: {', '.join(kinds) or 'none'}"


def _silent_note(record: FleetLog) -> tuple[str, ...]:
    silent = record.silent()
    if not silent:
        return ()
    ends = listed([f"{robot.name} ({robot.time[-1]:.1f} s)" for robot in silent])
    return (
        f"no poses are told to the end, {record.duration:.1f} s, of {ends}: from then on "
        f"{'it is' if len(silent) == 1 else 'they are'} taken to stand there",
    )


def _doubts(record: FleetLog, legs: tuple[tuple[Leg, ...], ...]) -> tuple[str, ...]:
    """Say what the log does not tell, so that a deadlock may be there that was not suspected."""
    found = []
    if record.duration < STOOD_FOR:
        found.append(
            f"it lasts {record.duration:.0f} s; robots are suspected after {STOOD_FOR:.0f}"
        )
    if record.is_cut:
        found.append("not all of it could be read")
    silent = [robot.name for robot in record.silent()]
    if silent:
        found.append(f"whether {listed(silent)} moved after their last poses")
    idle = [
        robot.name
        for robot, rows in zip(record.robots, legs, strict=True)
        if not any(leg.origin in ("told", "path") for leg in rows)
        and record.duration - _stands_since(robot) >= STOOD_FOR
    ]
    if idle:
        found.append(f"where {listed(idle)} {'was' if len(idle) == 1 else 'were'} to go")
    return tuple(found)


def _stands_since(robot: RobotLog) -> float:
    """Find since when a robot has been where it is at the end [s]."""
    away = np.hypot(*(robot.pose[:, :2] - robot.pose[-1, :2]).T) > HALTS_WITHIN
    moved = np.flatnonzero(away)
    return float(robot.time[moved[-1]]) if len(moved) else 0.0


def _map_note(record: FleetLog, known: World | None) -> tuple[str, ...]:
    if known is not None or record.grid is not None:
        return ()
    return ("the log has no map: the floor is open (give --floor)",)


def _comment(source: Path, scene: Scene, members: tuple[str, ...], waits: tuple[str, ...]) -> str:
    is_deadlock = claim_kind({"members": members}) == "deadlock"
    of = "suspected of a deadlock" if is_deadlock else "suspected to be stuck"
    what = f"{', '.join(members)} {of}" if members else "no deadlock suspected"
    lines = [
        f"The neighbourhood of {source.name}, from {scene.begin:.1f} s on: {what}.",
        "",
        *(f"- {line}" for line in waits),
        *([""] if waits else []),
        "Starts, headings, arrivals and goals vary around it; -p spread=0 is the incident itself.",
    ]
    return "\n".join(lines)


def _confirmation(
    world: World, stack: Stack, settings: tuple[str, ...], members: set[str]
) -> Confirmation:
    from mrta_falsify.commands.run import run  # noqa: PLC0415 - loads the simulator

    outcome = run(world, stack, settings=settings, specs=("no_deadlock",), keep_trace=False)
    (verdict,) = (v for v in outcome.verdicts if v.spec == "no_deadlock")
    found = wait_account(verdict).members if verdict.violated else ()
    return Confirmation(
        stack=str(stack) if isinstance(stack, (str, Path)) else "given",
        deadlock=verdict.violated,
        members=found,
        same=bool(found) and (set(found) <= members or members <= set(found)),
        delivered=outcome.tasks.completed,
        tasks=outcome.tasks.total,
        kind=kind_of([verdict]),
    )
