"""Forecasts: what a copy of a run shows, and that the run does not notice."""

import dataclasses
import os
import signal

import numpy as np
import pytest
from shapely.geometry import box

from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, CommsOutage, Task
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.testing.floors import robot, two_rooms
from mrta_falsify.testing.planted import CREEPS, STANDS
from mrta_falsify.testing.stacks import IN_TURN, SYMMETRIC, stack
from simulator_interface.episode import Episode
from simulator_interface.forecast import EpisodeForecast
from simulator_interface.simulate import simulate

ENGINES = ("bullet", "kinematic", "mujoco")
DRIVE = Task(arrival=0.0, start=0, end=1, deadline=900.0)


def rooms(*, width: float = 1.0, robots=None, tasks=(DRIVE,), events=(), horizon=60.0):
    """Two rooms of 2 m joined by a passage of 3 m; one robot in the left one."""
    world = two_rooms(box(-1.5, -width / 2, 1.5, width / 2), side=2.0, gap=3.0)
    robots = robots or (robot(0, -2.5, 0.0),)
    return dataclasses.replace(
        world, robots=robots, tasks=tasks, events=tuple(events), horizon=horizon
    )


def swap():
    """Two robots that want through a passage for one; neither gives way."""
    robots = (robot(0, -2.5, 0.0), robot(1, 2.5, 0.0, np.pi))
    tasks = (DRIVE, Task(arrival=0.0, start=1, end=0, deadline=900.0))
    return rooms(width=0.7, robots=robots, tasks=tasks), stack(SYMMETRIC, allocator=IN_TURN)


class Looking:
    """Poses, robots with a goal, and open ways until a time."""

    def __init__(self, until: float) -> None:
        self.until = until
        self.seen: list = []
        self.goals: set[int] = set()
        self.kinds: set[str] = set()

    def update(self, frame) -> bool:
        self.seen.append(frame.sensed.pose.tolist())
        self.goals |= set(np.flatnonzero(np.isfinite(frame.intent.goal[:, 0])).tolist())
        self.kinds |= {event.kind for event in frame.events}
        return frame.sensed.time >= self.until

    def answer(self) -> dict:
        return {"seen": self.seen, "goals": sorted(self.goals), "kinds": sorted(self.kinds)}


def on(engine: str, config=None):
    return dataclasses.replace(config or stack(), engine=Choice(engine))


def begun(world, config, until: float):
    """An episode that has come to ``until`` [s], its frames, and forecasts from there."""
    episode = Episode(world, config)
    frames = episode.frames()
    while next(frames).sensed.time < until - 1e-9:
        pass
    return episode, frames, EpisodeForecast(episode, frames)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_forecast_is_what_then_happens(engine):
    _, frames, forecast = begun(rooms(), on(engine), 2.0)
    foreseen = forecast(Looking(5.0))["seen"]
    happened = [next(frames).sensed.pose.tolist() for _ in foreseen]
    assert len(foreseen) == 30
    assert foreseen == happened
    assert foreseen[0] != foreseen[-1]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_that_is_asked_about_goes_on_as_if_it_had_not_been(engine):
    world, config = swap()
    config = on(engine, config)
    plain = simulate(world, config, specifications=build_specifications(("all_tasks_done",)))
    asked = simulate(world, config, specifications=build_specifications((STANDS,)))
    (verdict,) = asked.verdicts
    assert verdict.violated
    assert asked.trace.digest == plain.trace.digest


def test_tasks_still_to_arrive_are_left_out():
    late = Task(arrival=5.0, start=1, end=0, deadline=900.0)
    world = rooms(tasks=(late,))
    _, _, forecast = begun(world, stack(), 2.0)
    assert forecast(Looking(10.0))["goals"] == []
    _, _, forecast = begun(world, stack(), 5.2)
    assert forecast(Looking(10.0))["goals"] == [0]


@pytest.mark.parametrize("engine", ENGINES)
def test_blockages_and_outages_still_to_begin_are_left_out(engine):
    cart = Blockage(name="cart", polygon=rectangle(0.5, 1.0, (0.0, 0.0)), start=1.5, end=1e6)
    cut = CommsOutage(name="cut", robots=(), links=("states",), start=1.5, end=1e6)
    world = rooms(events=(cart, cut))
    _, frames, forecast = begun(world, on(engine), 1.0)
    foreseen = forecast(Looking(20.0))
    assert foreseen["seen"][-1][0][0] > 2.0
    assert "comms-lost" not in foreseen["kinds"]
    happened = Looking(20.0)
    while not happened.update(next(frames)):
        pass
    assert happened.seen[-1][0][0] < 0.0
    assert "comms-lost" in happened.kinds


@pytest.mark.parametrize("engine", ENGINES)
def test_without_one_of_two_that_block_each_other_the_other_goes_free(engine):
    world, config = swap()
    _, _, forecast = begun(world, on(engine, config), 15.0)
    together = np.array(forecast(Looking(35.0))["seen"])
    assert np.abs(together[-1, :, :2] - together[0, :, :2]).max() < 0.5
    alone = np.array(forecast(Looking(35.0), without=(1,))["seen"])
    assert alone[-1, 0, 0] > 2.0
    assert alone[0, 1, 0] < world.bounds[0] - 20.0  # far outside the map
    assert np.abs(alone[:, 1, :2] - alone[0, 1, :2]).max() < 0.05


def test_a_copy_that_fails_says_so_and_the_run_goes_on():
    class Broken(Looking):
        def update(self, frame):
            raise ValueError("no such thing")

    _, frames, forecast = begun(rooms(), stack(), 1.0)
    with pytest.raises(HarnessError, match="no such thing"):
        forecast(Broken(5.0))
    assert next(frames).sensed.time == pytest.approx(1.1)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_nudged_copy_differs_by_millimetres_each_in_its_own_way_and_the_run_stays(engine):
    robots = (robot(0, -2.5, 0.0), robot(1, 2.5, 0.0, np.pi))
    _, frames, forecast = begun(rooms(robots=robots), on(engine), 1.0)
    plain, first, again, second = (
        np.array(forecast(Looking(1.1), nudge=nudge)["seen"][0])[:, :2] for nudge in (0, 1, 1, 2)
    )
    away = np.hypot(*(first - plain).T)
    assert (away > 1e-4).all()
    assert (away < 0.02).all()
    assert np.array_equal(first, again)
    assert not np.array_equal(first, second)
    assert np.array_equal(next(frames).sensed.pose[:, :2], plain)


def head_on_in_a_lane():
    """Two robots that meet in a lane of 0.7 m without a bay, and push each other by creep."""
    world = two_rooms(box(-4.0, -0.35, 4.0, 0.35), side=3.0, gap=8.0)
    tasks = (DRIVE, Task(arrival=0.0, start=1, end=0, deadline=900.0))
    robots = (robot(0, -5.5, 0.3, 0.0), robot(1, 5.5, -0.3, np.pi))
    world = dataclasses.replace(world, robots=robots, tasks=tasks, horizon=25.0)
    return world, dataclasses.replace(stack(SYMMETRIC, allocator=IN_TURN), control_rate=20)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "judge"),
    [
        *(pytest.param(engine, CREEPS, id=engine) for engine in ENGINES),
        pytest.param("kinematic", "no_deadlock", id="to the end", marks=pytest.mark.long),
    ],
)
def test_a_creeping_pair_is_claimed_at_once_with_both_members_and_a_closed_cycle(engine, judge):
    world, config = head_on_in_a_lane()
    outcome = simulate(
        world,
        on(engine, config),
        specifications=build_specifications((judge,)),
    )
    (verdict,) = outcome.verdicts
    evidence = verdict.evidence
    assert set(verdict.who) == {"robot1", "robot2"}
    assert verdict.violated_at - evidence["onset"] < 5.0
    assert evidence["confirmed"]
    assert [(edge["robot"], edge["cause"], edge["blocked_by"]) for edge in evidence["cycle"]] == [
        ("robot1", "barrier", "robot2"),
        ("robot2", "barrier", "robot1"),
    ]


# --- one copy for many questions -----------------------------------------------------------------


class Stretch:
    """Poses over a stretch of time, for several stretches of one future."""

    def __init__(self, series, begin: float, end: float) -> None:
        self.series = series
        self.question = (begin, end)
        self.process = 0
        self.poses: dict = {}

    def resume(self, question) -> bool:
        self.question = question
        return max(self.poses, default=0.0) >= question[1]

    def update(self, frame) -> bool:
        self.poses[round(frame.sensed.time, 3)] = frame.sensed.pose.tolist()
        self.process = os.getpid()
        return self.resume(self.question)

    def answer(self) -> dict:
        begin, end = self.question
        poses = [pose for time, pose in self.poses.items() if begin < time <= end]
        return {"seen": poses, "process": self.process}


@pytest.mark.parametrize("engine", ENGINES)
def test_questions_about_one_future_go_to_one_copy(engine):
    _, frames, forecast = begun(rooms(), on(engine), 1.0)
    series = object()
    first = forecast(Stretch(series, 1.0, 2.0))
    further = forecast(Stretch(series, 2.0, 3.0))
    again = forecast(Stretch(series, 1.5, 2.5))
    assert first["process"] == further["process"] == again["process"] != os.getpid()
    happened = [next(frames).sensed.pose.tolist() for _ in first["seen"] + further["seen"]]
    assert first["seen"] + further["seen"] == happened
    assert again["seen"] == happened[5:15]


def test_another_future_gets_another_copy():
    episode, _, forecast = begun(rooms(), stack(), 1.0)
    series = object()
    first = forecast(Stretch(series, 1.0, 2.0))
    other = forecast(Stretch(object(), 1.0, 2.0))
    assert other["process"] != first["process"]
    episode.add_blockage("cart", rectangle(0.5, 1.0, (0.0, 0.0)), height=1.0, end=1e6)
    blocked = forecast(Stretch(series, 1.0, 20.0))
    assert blocked["process"] != first["process"]
    assert blocked["seen"][-1][0][0] < 0.0


def test_a_copy_that_was_killed_is_replaced():
    _, _, forecast = begun(rooms(), stack(), 1.0)
    series = object()
    first = forecast(Stretch(series, 1.0, 2.0))
    os.kill(first["process"], signal.SIGKILL)
    os.waitid(os.P_PID, first["process"], os.WEXITED | os.WNOWAIT)
    again = forecast(Stretch(series, 1.0, 2.0))
    assert again["process"] != first["process"]
    assert again["seen"] == first["seen"]


def test_a_copy_of_the_run_asks_a_copy_of_its_own():
    _, _, forecast = begun(rooms(), stack(), 1.0)
    series = object()
    first = forecast(Stretch(series, 1.0, 2.0))
    inside = run_supervised(lambda: forecast(Stretch(series, 1.0, 2.0)))
    assert inside["seen"] == first["seen"]
    assert inside["process"] != first["process"]
    assert forecast(Stretch(series, 1.0, 3.0))["process"] == first["process"]


def test_the_copy_ends_with_the_episode():
    _, frames, forecast = begun(rooms(), stack(), 1.0)
    process = forecast(Stretch(object(), 1.0, 2.0))["process"]
    frames.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
