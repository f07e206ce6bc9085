"""When a tick is over, with messages that come when the test says."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace

import pytest

pytest.importorskip("cyclonedds")
pytest.importorskip("rosbags")

from simulator_interface.foreign.dds.bridge_settings import BridgeSettings
from simulator_interface.foreign.dds.waiting import Silence, end_of_ticks
from simulator_interface.foreign.last_values import LastValue
from simulator_interface.foreign.robot_topics import NANO, RobotTopics, Topics
from tests.foreign.plain_messages import make
from tests.foreign.seen_worlds import world_seen


class ScriptedLink:
    """Takes one row of a script at each look: what comes then."""

    def __init__(self) -> None:
        self.script: list[Callable[[], None]] = []
        self.handlers: dict[str, Callable] = {}
        self.waits = 0

    def listen(self, topic, handle, *, wakes: bool = True) -> None:
        self.handlers[topic.name] = handle

    def take(self) -> int:
        if not self.script:
            return 0
        self.script.pop(0)()
        return 1

    def wait(self, until: float) -> int:
        self.waits += 1
        if not self.script:
            time.sleep(max(0.0, until - time.monotonic()))
        return self.take()

    def acknowledge(self, *data: int, name: str = "/clock_done") -> Callable[[], None]:
        return lambda: self.handlers[name](SimpleNamespace(data=list(data)))


class Scene:
    """A way of waiting for two robots' nodes."""

    def __init__(self, **settings) -> None:
        topics = RobotTopics(world_seen(2), Topics(stamped=True), make)
        self.link, self.heard = ScriptedLink(), LastValue(topics)
        self._commands = [topic for topic in topics.heard if topic.field == "cmd_vel"]
        self.looked = 0
        chosen = BridgeSettings(**settings)
        self.waiting = end_of_ticks(chosen, self.link, self.heard, self._look)

    def _look(self) -> None:
        self.looked += 1

    def command(self, robot: int, stamp: int) -> Callable[[], None]:
        message = make("geometry_msgs/msg/TwistStamped")
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANO)
        return lambda: self.heard.take_in(self._commands[robot], message)

    def tick(self, now: int, *comes: Callable[[], None]) -> float:
        """Wait for a tick; give how long it took [s]."""
        self.heard.now, self.link.script = now, list(comes)
        began = time.monotonic()
        self.waiting.until_done()
        return time.monotonic() - began


def nothing() -> None:
    pass


# --- stepped --------------------------------------------------------------------------------


def test_an_acknowledgement_of_this_clock_ends_a_tick_and_no_other_does():
    scene = Scene()
    scene.tick(0, nothing, scene.link.acknowledge(0))
    acknowledged = scene.link.acknowledge
    scene.tick(50, acknowledged(0), acknowledged(49), acknowledged(), acknowledged(50), nothing)
    assert scene.link.script == [nothing]


def test_all_who_have_to_acknowledge_are_waited_for():
    scene = Scene(done=("/a", "/b"))
    at_a, at_b = (scene.link.acknowledge(7, name=name) for name in ("/a", "/b"))
    scene.tick(7, at_b, nothing, at_a, nothing)
    assert scene.link.script == [nothing]


def test_commands_that_an_acknowledgement_has_overtaken_are_waited_for():
    scene = Scene()
    scene.tick(
        *(9, scene.link.acknowledge(9, 2)),
        *(scene.command(1, 9), nothing, scene.command(0, 9), nothing),
    )
    assert scene.heard.published_at == [9, 9]
    assert scene.link.script == [nothing]


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        ((), "clock 2.000 s was not acknowledged on /clock_done within 0.05 s"),
        ((2 * NANO, 3), "0 of 3 published messages came within 0.05 s"),
    ],
)
def test_a_clock_that_nobody_acknowledges_has_a_limit(sent, said):
    scene = Scene(step_limit=0.05)
    with pytest.raises(Silence, match=said):
        scene.tick(2 * NANO, scene.link.acknowledge(*sent))
    assert scene.looked


# --- awaited --------------------------------------------------------------------------------

LIMIT = 0.1  # s, of a tick


def awaited(**more) -> Scene:
    return Scene(coupling="awaited", await_limit=LIMIT, **more)


def test_nobody_is_waited_for_before_a_first_command():
    scene = awaited()
    scene.tick(0)
    assert scene.link.waits == 0


def test_a_robot_that_has_been_commanded_is_waited_for_until_its_command_of_this_tick():
    scene = awaited()
    scene.tick(1, scene.command(0, 1))
    scene.tick(2, nothing, scene.command(0, 1), scene.command(0, 2), nothing)
    assert scene.link.script == [nothing]
    assert scene.heard.published_at[0] == 2


def test_a_robot_without_a_command_costs_one_limit_and_counts_again_once_it_speaks():
    scene = awaited()
    scene.tick(1, scene.command(1, 1))
    assert scene.tick(2) >= LIMIT
    waited = scene.link.waits
    scene.tick(3)
    assert scene.link.waits == waited
    scene.tick(4, scene.command(1, 4))
    scene.tick(5, nothing, scene.command(1, 5))
    assert scene.heard.published_at[1] == 5


def test_a_slower_robot_is_waited_for_when_its_next_command_is_due():
    scene = awaited(command_every=2e-9)
    scene.tick(1, scene.command(0, 1))
    waited = scene.link.waits
    scene.tick(2)
    assert scene.link.waits == waited
    scene.tick(3, nothing, scene.command(0, 3))
    assert scene.link.waits > waited


# --- paced ----------------------------------------------------------------------------------


def test_simulated_time_keeps_to_the_wall_clock():
    scene = Scene(coupling="paced", rate=2.0)
    began = time.monotonic()
    for number in range(6):
        scene.tick(number * NANO // 25)  # 0.04 s
    assert time.monotonic() - began >= 5 * 0.04 / 2.0


def test_messages_are_taken_while_time_passes():
    scene = Scene(coupling="paced", rate=1.0)
    scene.tick(0)
    scene.tick(NANO // 50, nothing, scene.command(0, 3))
    assert scene.heard.published_at[0] == 3
