"""Which moments of each scene tell its story; the pictures show them, the tests assert them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import World
from mrta_falsify.testing.watching import AT_REST, events, first_time, path_at, speed, tick_of, when
from tests.scenes import worlds
from tests.scenes.test_paper_scenes import PAPERS_RULE


@dataclass(frozen=True)
class Moment:
    """One panel: when, and what is to be seen."""

    time: float  #: [s]
    caption: str


@dataclass(frozen=True)
class Scene:
    """One picture: a world, how it is run, its moments, the part of the floor to show."""

    name: str  #: of the file
    title: str
    world: Callable[[], World]
    moments: Callable[[World, Trace], list[Moment]]
    window: tuple[float, float, float, float]  #: x min, y min, x max, y max [m]
    settings: tuple[str, ...] = ()


def _moved_aside(world: World, trace: Trace) -> list[Moment]:
    del world
    moving = first_time(trace, speed(trace, 1) > AT_REST)
    near = first_time(trace, trace.columns["pose"][:, 0, 0] > 4.7)
    passed = first_time(trace, trace.columns["pose"][:, 0, 0] > 8.0)
    return [
        Moment(moving - 0.5, "robot2 has no task and stands in the passage, the only way"),
        Moment(moving + 1.0, "robot1 got a task, leads the cluster and commands robot2"),
        Moment(near + 0.5, "robot2 drives ahead of it, through the passage and to the side"),
        Moment(passed, "robot1 has passed; robot2 stays where it was put"),
    ]


def _queue_tail(world: World, trace: Trace) -> list[Moment]:
    spot = world.resources[2].spots[0]
    asked = when(trace, "waits-for", 0, resource="ward_2")
    head = first_time(trace, trace.columns["queue"][:, 0] == 0, after=asked)
    granted = when(trace, "granted", 0, resource="ward_2")
    to_head = [
        e.time
        for e in events(trace, "replanned", 0)
        if e.time >= head
        and np.hypot(*(path_at(trace, 0, tick_of(trace, e.time))[-1] - spot)) < 0.3
    ]
    return [
        Moment(asked - 0.3, "robot1 has no place in the queue yet: its path ends at spot 3"),
        Moment(asked + 0.5, "near enough, it asks and comes second: it re-plans to spot 2"),
        Moment(to_head[0] + 0.5, "robot2 has the room; robot1 re-plans to the head, spot 1"),
        Moment(granted + 0.5, "the room is its own: it re-plans into the room"),
    ]


def _wait_replan(world: World, trace: Trace) -> list[Moment]:
    del world
    ready = when(trace, "picked-up", 0)
    free = first_time(trace, trace.columns["leader"][:, 0] == 0, after=ready)
    again = [e.time for e in events(trace, "replanned", 0) if e.time > free]
    return [
        Moment(ready - 0.5, "robot1 loads; robot2, first in priority, drives west"),
        Moment(ready + 3.5, "robot1 has its path but waits: robot2 leads their cluster"),
        Moment(free, "robot2 is 4 m away: the cluster ends, robot1 leads itself"),
        Moment(again[0] + 0.5, "robot1 has re-planned and follows its path"),
    ]


def _leadership(world: World, trace: Trace) -> list[Moment]:
    del world
    began = when(trace, "assigned", 0)
    cluster, leader = trace.columns["cluster"], trace.columns["leader"]
    shrunk = first_time(trace, cluster[:, 2] == 2, after=began + 0.5)
    alone = first_time(trace, leader[:, 0] == 0, after=shrunk)
    return [
        Moment(began + 0.6, "three robots, one cluster: robot3 goes first and leads"),
        Moment(shrunk + 0.3, "robot3 is out of reach in its room: now robot2 leads"),
        Moment(alone - 0.3, "robot2 drives off; robot1 still waits for it"),
        Moment(alone + 2.0, "robot1 is alone, leads itself and goes"),
    ]


def _blocked(world: World, trace: Trace) -> list[Moment]:
    bed = world.events[0]
    lost = when(trace, "no-path", 0)
    return [
        Moment(bed.start - 0.5, "robot1 drives east, robot2 west, to the same room"),
        Moment(lost + 1.0, "a bed across the corridor: robot1 has no path and stops"),
        Moment(when(trace, "dropped-off", 1) + 2.0, "robot2 is not held up; it delivers"),
        Moment(bed.end + 5.0, "the corridor is open: robot1 has a path again and goes"),
    ]


CUT, BACK = worlds.OUTAGE


def _leader_cut(world: World, trace: Trace) -> list[Moment]:
    del world
    rest = first_time(trace, speed(trace, 0) <= AT_REST + 0.01, after=CUT)
    return [
        Moment(CUT - 0.5, "robot1 follows robot2, the leader of their cluster"),
        Moment(CUT + 0.2, "link cut: the last command holds until it is 0.25 s old"),
        Moment(rest, "robot1 has braked to rest"),
        Moment(CUT + 8.0, "and goes on, controlling itself alone"),
    ]


def _states_cut(world: World, trace: Trace) -> list[Moment]:
    del world, trace
    return [
        Moment(CUT - 0.5, "two robots in a row, one cluster"),
        Moment(CUT + 2.0, "robot1 does not hear where the others are: it stops"),
        Moment(CUT + 12.0, "robot2 goes on to its room"),
        Moment(BACK + 4.0, "the link is back: robot1 goes on"),
    ]


def _planner_cut(world: World, trace: Trace) -> list[Moment]:
    del world
    waits = first_time(trace, trace.columns["phase"][:, 0] == Phase.PLANNING, after=CUT)
    return [
        Moment(CUT - 0.5, "two robots in a row, both with a path"),
        Moment(CUT + 4.0, "no planning service for robot1: it follows the path it has"),
        Moment(waits + 4.0, "at the end of the path it waits; robot2 gets new paths"),
        Moment(BACK + 4.0, "the link is back: robot1 has a new path"),
    ]


def _dispatcher_cut(world: World, trace: Trace) -> list[Moment]:
    del world
    new = when(trace, "assigned", task=2)
    served = when(trace, "picked-up", 0)
    return [
        Moment(CUT - 0.5, "both robots have a delivery; robot1 will lose the dispatcher"),
        Moment(new + 0.5, "a new task arrives; robot1 cannot be told, so robot2 gets it"),
        Moment(BACK - 3.0, "robot1 goes on with its itinerary: it enters its first room"),
        Moment(served + 8.0, "and drives to the second"),
    ]


def _full_house(world: World, trace: Trace) -> list[Moment]:
    del world
    delivered = [e.time for e in events(trace, "dropped-off")]
    return [
        Moment(0.5, "six robots are parked in the six rooms, none has a task"),
        Moment(3.0, "robots 1, 3, 5 have a delivery for the room of robots 2, 4, 6"),
        Moment(13.0, "the idle ones leave for parking spots, and the rooms are given on"),
        Moment(max(delivered), "all delivered; nobody had to wait for ever"),
    ]


def _link_cut(link: str, where: str, moments, window) -> Scene:
    return Scene(
        name=f"{link}_link_cut",
        title=f"Link {where} cut from 8 s to 28 s",
        world=lambda: worlds.two_robots_in_a_row(link),
        moments=moments,
        window=window,
    )


SCENES = (
    Scene(
        name="idle_robot_moved_aside",
        title="An idle robot is moved aside by the leader",
        world=worlds.idle_robot_in_a_passage,
        moments=_moved_aside,
        window=(1.6, -0.2, 8.6, 3.2),
    ),
    Scene(
        name="queue_tail_then_place",
        title="Planning to the queue's tail, then to the place that was given",
        world=worlds.queue_of_a_busy_room,
        moments=_queue_tail,
        window=(5.9, -0.2, 16.3, 7.4),
    ),
    Scene(
        name="waits_then_replans",
        title="A robot waits for another, re-plans and goes (paper's rule: followers brake)",
        world=worlds.meeting_at_a_door,
        moments=_wait_replan,
        window=(1.2, -0.2, 13.8, 5.6),
        settings=(PAPERS_RULE,),
    ),
    Scene(
        name="leadership_passes_on",
        title="Leadership passes on as a cluster shrinks (paper's rule: followers brake)",
        world=worlds.three_robots_close_together,
        moments=_leadership,
        window=(0.4, -3.2, 11.4, 4.2),
        settings=(PAPERS_RULE,),
    ),
    Scene(
        name="corridor_blocked",
        title="A corridor is blocked from 7 s to 40 s",
        world=worlds.blocked_corridor,
        moments=_blocked,
        window=(-0.2, -0.2, 16.2, 6.2),
    ),
    _link_cut("leader", "to the leader", _leader_cut, (4.5, -0.2, 15.5, 5.5)),
    _link_cut("states", "between the robots' states", _states_cut, (4.5, -0.2, 15.5, 5.5)),
    _link_cut("planner", "to the planning service", _planner_cut, (4.5, -0.2, 19.5, 6.0)),
    _link_cut("dispatcher", "to the dispatcher", _dispatcher_cut, (4.5, -0.2, 24.2, 6.5)),
    Scene(
        name="idle_robots_make_room",
        title="Idle robots make room: a robot parked in each of the six rooms",
        world=lambda: worlds.full_house(((0, 1), (2, 3), (4, 5))),
        moments=_full_house,
        window=(-12.6, -33.0, 12.6, 5.0),
    ),
)
