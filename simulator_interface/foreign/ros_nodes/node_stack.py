"""A stack of the user's nodes: asked a tick, it runs them up to then and gives their commands."""

from __future__ import annotations

import functools
import random
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np

from simulator_interface.foreign.interfaces import read_interfaces
from simulator_interface.foreign.last_values import LastValue
from simulator_interface.foreign.robot_topics import Qos, RobotTopics, Topic, nanoseconds_of
from simulator_interface.foreign.ros_nodes import here, navigator
from simulator_interface.foreign.ros_nodes.fibres import NS, Timeline
from simulator_interface.foreign.ros_nodes.private_modules import PrivateModules
from simulator_interface.foreign.ros_nodes.quality import (
    DurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from simulator_interface.foreign.ros_nodes.ros_graph import Graph, Publisher, Subscription
from simulator_interface.foreign.ros_nodes.ros_messages import DEFINITIONS, message_class
from simulator_interface.foreign.ros_nodes.ros_programs import Launch, RunningProgram, start_all
from simulator_interface.foreign.ros_nodes.schedule import WIDEST_PHASE, Schedule, read_dials
from simulator_interface.foreign.ros_nodes.stand_ins import StandIns
from simulator_interface.foreign.ros_nodes.threads import threading_module, time_module

HELD = 1e9  # s that a command holds: until the next one, as with a driver that has no watchdog
START = 1.0  # s that ROS time is ahead: nodes take 0 for "no clock yet"


class ProgramDied(Exception):  # noqa: N818 - says what became of a program
    """A program of the stack has ended by an error; the text has its traceback."""


class NodeGraph:
    """Programs of nodes on simulated time, and the harness's ends of their topics.

    Args:
        world: message of the door.
        launches: the programs.
        folders: the user's modules are under.
        interfaces: folders with the user's .msg, .srv and .action files.
        patches: called with modules of the user's, by name, once they are loaded.

    Raises:
        UnknownDial: the parameters of the stack name a dial that there is not.
    """

    def __init__(
        self,
        world: Mapping[str, Any],
        launches: Sequence[Launch],
        *,
        folders: Sequence[str],
        interfaces: Sequence[str] = (),
        patches: Mapping[str, Callable[[ModuleType], object]] | None = None,
    ) -> None:
        names = [launch.name for launch in launches]
        dials = read_dials(world["params"], world["seed"], names)
        schedule = Schedule(dials)
        self.timeline = Timeline(schedule.order)
        self.timeline.run_until(round((START - WIDEST_PHASE) * NS))
        self.graph = Graph(self.timeline, schedule)
        here.enter(self.graph)
        still_chance(dials.seed)
        for folder in interfaces:
            DEFINITIONS.add(read_interfaces(Path(folder)))
        replaced = {"time": time_module(), "threading": threading_module()}
        modules = PrivateModules(folders, replaced, patches or {})
        sys.meta_path[:0] = [modules, StandIns()]
        self.programs = start_all(launches, self.timeline, modules, schedule.phases(names))
        self._told: set[str] = set()

    def publisher(self, kind: str, topic: str, qos: Qos | None = None) -> Publisher:
        """Publish to nodes, messages of the type ``kind``."""
        return Publisher(self.graph, message_class(kind), topic, _profile(qos))

    def listen(
        self, kind: str, topic: str, hear: Callable[[Any], object], qos: Qos | None = None
    ) -> None:
        """Have ``hear`` called with each message of a topic, when it arrives."""

        def take() -> None:
            while subscription.is_ready():
                subscription.take()()

        subscription = Subscription(
            self.graph, message_class(kind), topic, hear, _profile(qos), notify=take
        )

    def advance(self, time: float) -> None:
        """Run the programs up to ``time`` [s] of the world.

        Raises:
            ProgramDied: one of them has.
        """
        self.timeline.run_until(round((START + time) * NS))
        for program in self.programs:
            if program.is_dead and program.launch.name not in self._told:
                self._told.add(program.launch.name)
                raise ProgramDied(f"program {program.launch.name} died:\n{program.error}")

    def program(self, name: str) -> RunningProgram:
        """Give a program by its name."""
        return next(program for program in self.programs if program.launch.name == name)


class NodeStack:
    """A stack of nodes with the usual topics, for :func:`mrta_stack.serve`.

    Args:
        graph: its nodes.
        robot_topics: what is told and heard.
        harness: plans for the nodes.
        drives: who drives robots that are told a goal or a path: the nodes, by ``cmd_vel``, or the
            harness.
    """

    def __init__(
        self,
        graph: NodeGraph,
        robot_topics: RobotTopics,
        harness: Any,
        drives: Literal["nodes", "harness"] = "nodes",
    ) -> None:
        self._graph, self._topics, self._drives = graph, robot_topics, drives
        self._heard = LastValue(robot_topics)
        navigator.BasicNavigator.planner = staticmethod(harness.plan)
        self._publishers = {
            topic: graph.publisher(topic.type, topic.name, topic.qos)
            for topic in robot_topics.published
        }
        for topic in robot_topics.heard:
            hear = functools.partial(self._heard.take_in, topic)
            graph.listen(topic.type, topic.name, hear, topic.qos)
        self._publish(robot_topics.at_start())

    def step(self, tick: dict[str, Any]) -> dict[str, Any]:
        """Answer a tick."""
        self._heard.now = nanoseconds_of(tick["time"])
        self._publish(self._topics.at_tick(tick))
        self._graph.advance(tick["time"])
        answer: dict[str, Any] = {
            "goal": self._heard.goals(),
            "paths": self._heard.new_paths(),
            "events": self._heard.new_events(),
        }
        if self._drives == "harness":
            return {**answer, "follow": list(range(len(self._topics.robots)))}
        return {**answer, "twist": self._heard.twist(HELD)}

    def _publish(self, messages: Sequence[tuple[Topic, Any]]) -> None:
        for topic, message in messages:
            self._publishers[topic].publish(message)


def still_chance(seed: int) -> None:
    """Seed all random generators of this process, also those that code makes without a seed."""
    random.seed(seed)
    np.random.seed(seed % 2**32)  # noqa: NPY002 - the user's code may draw from it
    seeded = np.random.default_rng
    drawn = iter(range(sys.maxsize))

    def default_rng(own: Any = None) -> np.random.Generator:
        return seeded([seed, next(drawn)] if own is None else own)

    np.random.default_rng = default_rng  # type: ignore[assignment]


def _profile(qos: Qos | None) -> QoSProfile:
    if qos is None:
        return QoSProfile()
    durable, fleeting = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
    sure, quick = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(
        depth=qos.depth,
        reliability=sure if qos.is_reliable else quick,
        durability=durable if qos.is_transient_local else fleeting,
    )
