"""The bridge: each tick of the door becomes messages of ROS, and what nodes answer a command."""

from __future__ import annotations

import contextlib
import functools
import sys
import time
from collections.abc import Iterator
from typing import Any

from mrta_falsify.core.errors import ConfigError
from simulator_interface.clients.mrta_stack import Harness, serve
from simulator_interface.foreign.dds.bridge_settings import BridgeSettings
from simulator_interface.foreign.dds.domains import ReservedDomain, environment
from simulator_interface.foreign.dds.link import Link
from simulator_interface.foreign.dds.nodes import NodeEnded, Nodes
from simulator_interface.foreign.dds.waiting import Silence, TickEnd, end_of_ticks
from simulator_interface.foreign.dds.wire_types import WireTypes
from simulator_interface.foreign.interfaces import humble_types
from simulator_interface.foreign.last_values import LastValue
from simulator_interface.foreign.robot_topics import RobotTopics, nanoseconds_of

NAME = "ROS 2 by DDS"
LOOK_EVERY = 0.02  # s between two looks at who has been found


def run_bridge(settings: BridgeSettings) -> None:
    """Serve one episode over the socket of the door.

    Args:
        settings: of the bridge.

    Raises:
        ConfigError: the domain is not free or not known to the nodes, or a topic cannot be.
    """
    if not settings.commands and settings.domain is None:
        raise ConfigError(
            "neither commands nor domain is given; let the bridge start your nodes (commands), "
            "or name the domain of those that run already"
        )
    reserved = ReservedDomain(settings.domain)
    with contextlib.ExitStack() as open_things:

        def begin(world: dict[str, Any], harness: Harness) -> Bridge:
            del harness  # nodes have their own map and planner
            with _in_one_sentence():
                env = environment(reserved.number)
                nodes = Nodes(settings.commands, env, reserved.hold)
                open_things.callback(nodes.end)
                bridge = Bridge(settings, world, reserved.number, nodes)
            open_things.callback(bridge.close)
            return bridge

        serve(begin, name=NAME, says=settings.says, can=(), coupling=settings.coupling)


class Bridge:
    """The stack of one episode.

    Args:
        settings: of the bridge.
        world: message of the door.
        domain: of DDS.
        nodes: programs that the nodes are in.

    Raises:
        NodeEnded: one of them has ended.
        Silence: nobody is there.
    """

    def __init__(
        self, settings: BridgeSettings, world: dict[str, Any], domain: int, nodes: Nodes
    ) -> None:
        self._settings = settings
        self._nodes = nodes
        types = WireTypes(humble_types())
        self._link = Link(domain, types)
        self._topics = RobotTopics(world, settings.topics, types.make)
        self._heard = LastValue(self._topics)
        for topic in self._topics.published:
            self._link.advertise(topic)
        is_stepped = settings.coupling == "stepped"  # then only acknowledgements are waited for
        for topic in self._topics.heard:
            take_in = functools.partial(self._heard.take_in, topic)
            self._link.listen(topic, take_in, wakes=not is_stepped)
        self._tick_end: TickEnd = end_of_ticks(settings, self._link, self._heard, nodes.look)
        for topic, message in self._topics.at_start():
            self._link.publish(topic, message)
        self._find_nodes()

    def step(self, tick: dict[str, Any]) -> dict[str, Any]:
        """Answer a tick."""
        with _in_one_sentence():
            self._heard.now = nanoseconds_of(tick["time"])
            for topic, message in self._topics.at_tick(tick):
                self._link.publish(topic, message)
            self._tick_end.until_done()
        answer: dict[str, Any] = {
            "paths": self._heard.new_paths(),
            "events": self._heard.new_events(),
        }
        if self._settings.topics.goal_pose:
            answer["goal"] = self._heard.goals()
        if self._settings.drives == "harness":
            return {**answer, "follow": list(range(len(self._topics.robots)))}
        return {**answer, "twist": self._heard.twist(self._settings.stale_after)}

    def close(self) -> None:
        """Leave the domain."""
        self._link.close()

    def _find_nodes(self) -> None:
        """Wait until those are there whom a run needs, and nobody else has come for a while."""
        until = time.monotonic() + self._settings.start_limit
        matches, since = self._link.matches(), time.monotonic()
        while (missing := self._missing()) or time.monotonic() < since + self._settings.settle:
            if time.monotonic() > until:
                if not missing:
                    return  # somebody comes and goes all the time
                limit = f"within {self._settings.start_limit:g} s (start_limit)"
                raise Silence(f"no node was found {limit} that {missing}")
            self._nodes.look()
            time.sleep(LOOK_EVERY)
            found = self._link.matches()
            if found != matches:
                matches, since = found, time.monotonic()

    def _missing(self) -> str:
        """Say what no node does yet that the first tick needs; empty: nothing."""
        settings = self._settings
        for name in settings.done if settings.coupling == "stepped" else ():
            if not self._link.publishers(name):
                return f"publishes {name}"
        clock = settings.topics.clock
        if settings.coupling == "stepped" and clock and not self._link.listeners(clock):
            return f"listens to {clock}"
        field = "cmd_vel" if settings.drives == "stack" else "goal_pose"
        names = [topic.name for topic in self._topics.heard if topic.field == field]
        if names and not any(self._link.publishers(name) for name in names):
            return f"publishes any of {', '.join(names[:3])}"
        return ""


@contextlib.contextmanager
def _in_one_sentence() -> Iterator[None]:
    """End this process by a sentence if the nodes let it down: the harness shows the last line."""
    try:
        yield
    except (NodeEnded, Silence) as error:
        sys.exit(f"bridge: {error}")
