"""Fixtures that more than one folder uses."""

from __future__ import annotations

import dataclasses
import os
import signal
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.fleet import (
    BlockedBy,
    Command,
    Frame,
    Intent,
    Phase,
    Sensed,
    StackEvent,
    nothing_sensed,
)
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.trace import Trace, TraceRecorder
from mrta_falsify.core.world import Furniture, HumanSpec, RobotSpec, Room, Task, Wall, World
from tests.shared_parses import share_parses

# Timings of a shared machine must not fail a property; the examples are few and fixed in CI.
settings.register_profile("house", deadline=None, max_examples=40, derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "house"))

# Commands that the tests start hear Ctrl-C even where a script runs the tests in its background.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Keys and trust of the tests are their own, and so are those of the commands that they start.
if "PYTEST_XDIST_WORKER" not in os.environ:  # its processes share those of the first
    os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="mrta-falsify-tests-")

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / "shared" / "data"

#: Parts of ``make long``, by folder or module; the last part has what stands in no other.
PARTS = (
    ("test_docs.py", "test_gallery.py", "test_tutorials.py"),
    ("recorded", "reports", "scenes", "survival", "test_site.py", "test_wheel.py"),
    ("campaigns", "examples", "external", "foreign", "scenic_worlds"),
    ("cli", "contracts", "formats", "fuzz", "samplers", "specs", "test_experiments.py"),
    (),
)


def part_of(path: Path) -> int:
    """Say to which part of ``make long`` the long tests of a module belong, from 1 on."""
    for number, places in enumerate(PARTS, start=1):
        if any(path.is_relative_to(HERE / place) for place in places):
            return number
    return len(PARTS)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that chooses a part."""
    parser.addoption(
        "--part",
        type=int,
        choices=range(1, len(PARTS) + 1),
        help="only the long tests of this part; without it those of all parts",
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the long tests of other parts."""
    part = config.getoption("--part")
    if part is None:
        return
    kept, others = [], []
    for item in items:
        is_long = any(map(item.get_closest_marker, ("long", "browser")))
        is_other = is_long and part_of(item.path) != part
        (others if is_other else kept).append(item)
    config.hook.pytest_deselected(items=others)
    items[:] = kept


def pytest_collection_finish(session: pytest.Session) -> None:
    """Let the tests of this process share what Scenic parses."""
    share_parses()


@pytest.fixture
def reference_data() -> Path:
    """Folder of the published reference data; tests that need it are skipped without it."""
    if not DATA.is_dir():
        pytest.skip("the reference data is not on this machine")
    return DATA


@pytest.fixture
def hall() -> World:
    """The hall of :func:`hall_world`."""
    return hall_world()


def hall_world() -> World:
    """Build a 12 m x 8 m hall with a table, two rooms, two robots, one person and two tasks."""
    walls = [
        ("south", rectangle(12.4, 0.2, (6.0, -0.1))),
        ("north", rectangle(12.4, 0.2, (6.0, 8.1))),
        ("west", rectangle(0.2, 8.4, (-0.1, 4.0))),
        ("east", rectangle(0.2, 8.4, (12.1, 4.0))),
    ]
    return World(
        name="hall",
        bounds=frozen_array([-0.5, -0.5, 12.5, 8.5]),
        walls=tuple(Wall(name=name, polygon=polygon) for name, polygon in walls),
        furniture=(Furniture(name="table", kind="desk", polygon=rectangle(2.0, 1.0, (6.0, 4.0))),),
        rooms=(
            Room(name="store", point=frozen_array([1.5, 2.0])),
            Room(name="ward", point=frozen_array([10.5, 6.0])),
        ),
        travel_times=frozen_array([[0.0, 20.0], [20.0, 0.0]]),
        robots=(
            RobotSpec(name="robot1", pose=frozen_array([1.5, 2.0, 0.0])),
            RobotSpec(name="robot2", pose=frozen_array([10.5, 6.0, np.pi])),
        ),
        humans=(HumanSpec(name="human1", route=frozen_array([[2.0, 6.5], [9.0, 6.5]])),),
        tasks=(
            Task(arrival=0.0, start=0, end=1, deadline=100.0),
            Task(arrival=5.0, start=1, end=0, deadline=120.0),
        ),
        horizon=60.0,
    )


@pytest.fixture
def hall_trace(hall: World) -> Trace:
    """Ten seconds in which the robots of ``hall`` swap places around the table."""
    return scripted_trace(hall, seconds=10.0)


def scripted_trace(world: World, *, seconds: float, dt: float = 0.05, keep: bool = True) -> Trace:
    """Trace of robots that drive straight to one another's starts; no engine, no stack."""
    robots = len(world.robots)
    recorder = TraceRecorder(
        world_digest=world.digest(),
        dt=dt,
        robots=tuple(robot.name for robot in world.robots),
        humans=tuple(human.name for human in world.humans),
        keep=keep,
    )
    starts = np.array([robot.pose for robot in world.robots]).reshape(-1, 3)
    ends = np.roll(starts, -1, axis=0)
    path = tuple(np.array([a[:2], b[:2]]) for a, b in zip(starts, ends, strict=True))
    ticks = round(seconds / dt)
    for tick in range(ticks + 1):
        share = tick / ticks
        events = ()
        if tick == 0 and world.tasks:
            events = (StackEvent(time=0.0, kind="picked-up", robot=0, task=0, resource="store"),)
        if tick == ticks and world.tasks:
            events = (StackEvent(time=seconds, kind="dropped-off", robot=0, task=0),)
        edges = (BlockedBy(0, "queue", 1, "store"),) if 20 <= tick < 60 else ()
        recorder.add(
            Frame(
                sensed=_sensed(world, tick, tick * dt, starts + share * (ends - starts)),
                command=Command(twist=np.zeros((robots, 3))),
                intent=_intent(robots, path, Phase.QUEUEING if edges else Phase.DRIVING, ends),
                events=events,
                served=np.zeros(robots, dtype=np.int64),
                blocked_by=edges,
            )
        )
    return recorder.finish("horizon")


def _sensed(world: World, tick: int, time: float, pose: np.ndarray) -> Sensed:
    robots, humans = len(world.robots), len(world.humans)
    people = np.array([human.route[0] for human in world.humans]).reshape(-1, 2)
    return dataclasses.replace(
        nothing_sensed(robots, humans, rays=12),
        tick=tick,
        time=time,
        pose=pose,
        human_position=people + np.array([0.5 * time, 0.0]),
        gap_static=np.full(robots, 0.5),
        contact=np.zeros((robots, 3), dtype=bool) | (40 <= tick < 45),
    )


def _intent(robots: int, path: tuple, phase: Phase, ends: np.ndarray) -> Intent:
    return Intent(
        phase=np.full(robots, int(phase)),
        goal=ends[:, :2],
        waypoint=ends[:, :2],
        path=path,
        cluster=np.zeros(robots, dtype=int),
        leader=np.zeros(robots, dtype=int),
        slack=np.zeros(robots),
        tasks_left=np.ones(robots, dtype=int),
        queue=np.full(robots, -1),
        waits_for=("",) * robots,
    )


@pytest.fixture(scope="session")
def stalled():
    """A world and its judged run in which one robot stalls for good (a planted defect)."""
    from mrta_falsify.trial import judge
    from tests.reports.planted import stalled_job

    job = stalled_job()
    return job.world, judge(job)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let experiments run in this process instead of in workers."""
    from mrta_falsify.core.config import Choice
    from mrta_falsify.lab import laboratory

    monkeypatch.setattr(laboratory, "local_workers", lambda count: Choice("serial"))
