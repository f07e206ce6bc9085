"""When a tick is over: the three ways in which nodes that run by themselves are coupled to it.

No message of ROS says "that is all for this tick". So either a node says it (*stepped*), or its
commands are taken for it (*awaited*), or wall-clock time decides (*paced*).
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any, Protocol

from mrta_falsify.core.external import Coupling
from simulator_interface.foreign.dds.bridge_settings import BridgeSettings
from simulator_interface.foreign.dds.link import Link
from simulator_interface.foreign.last_values import NEVER, LastValue
from simulator_interface.foreign.robot_topics import NANO, Qos, Topic

SLICE = 0.5  # s of one wait; between two it is looked whether the nodes still run
#: s between two looks for messages that were published before an acknowledgement that overtook them
OVERTAKEN = 0.001
DONE_TYPE = "std_msgs/msg/UInt64MultiArray"


class Silence(Exception):  # noqa: N818 - says what did not happen
    """The nodes have not said what a tick needs."""


class TickEnd(Protocol):
    """Decides when a tick is over."""

    def until_done(self) -> None:
        """Return when the answer to the tick of ``heard.now`` may be given.

        Raises:
            Silence: it never may.
        """


def end_of_ticks(
    settings: BridgeSettings, link: Link, heard: LastValue, look: Callable[[], None]
) -> TickEnd:
    """Choose by the coupling.

    Args:
        settings: of the bridge.
        link: by which messages come.
        heard: they go there.
        look: whether the nodes still run; it raises if not.
    """
    ends: dict[Coupling, Callable[..., TickEnd]]
    ends = {"stepped": Stepped, "awaited": Awaited, "paced": Paced}
    return ends[settings.coupling](settings, link, heard, look)


class Stepped:
    """Waits for acknowledgements of the clock; see :class:`TickEnd` and :func:`end_of_ticks`.

    An acknowledgement is ``[clock in ns]``, or ``[clock in ns, messages published since the
    start]``. With the second number nothing is left to the order in which topics arrive: the tick
    is over when all these messages are there.
    """

    def __init__(
        self, settings: BridgeSettings, link: Link, heard: LastValue, look: Callable[[], None]
    ) -> None:
        self._settings, self._link, self._heard, self._look = settings, link, heard, look
        self._acknowledged = dict.fromkeys(settings.done, (NEVER, 0))
        for name in settings.done:
            link.listen(done_topic(name), functools.partial(self._note, name))

    def until_done(self) -> None:
        """See :class:`TickEnd`."""
        until = time.monotonic() + self._settings.step_limit
        self._link.take()
        while (late := self._late()) or self._heard.messages < self._sent():
            if time.monotonic() > until:
                raise Silence(self._complaint())
            self._look()
            self._link.wait(min(until, time.monotonic() + (SLICE if late else OVERTAKEN)))

    def _note(self, name: str, message: Any) -> None:
        clock, sent = (*message.data, 0)[:2] if len(message.data) else (NEVER, 0)
        self._acknowledged[name] = clock, sent

    def _late(self) -> list[str]:
        """List the topics on which the clock has not been acknowledged."""
        rows = self._acknowledged.items()
        return [name for name, (clock, _) in rows if clock != self._heard.now]

    def _sent(self) -> int:
        return sum(sent for _, sent in self._acknowledged.values())

    def _complaint(self) -> str:
        limit = f"within {self._settings.step_limit:g} s (step_limit)"
        if late := self._late():
            now = f"{self._heard.now / NANO:.3f} s"
            return f"clock {now} was not acknowledged on {', '.join(late)} {limit}"
        return f"{self._heard.messages} of {self._sent()} published messages came {limit}"


class Awaited:
    """Waits for a command of each active robot; see :class:`TickEnd` and :func:`end_of_ticks`.

    A robot is active from its first command on, until a tick in which none has come in time.
    """

    def __init__(
        self, settings: BridgeSettings, link: Link, heard: LastValue, look: Callable[[], None]
    ) -> None:
        self._settings, self._link, self._heard, self._look = settings, link, heard, look
        self._period = max(1, round(settings.command_every * NANO))
        self._given_up = [NEVER] * len(
            heard.published_at
        )  # the command after which none came in time

    def until_done(self) -> None:
        """See :class:`TickEnd`."""
        until = time.monotonic() + self._settings.await_limit
        self._link.take()
        while (missing := self._missing()) and time.monotonic() < until:
            self._look()
            self._link.wait(min(until, time.monotonic() + SLICE))
        for robot in missing:
            self._given_up[robot] = self._heard.published_at[robot]

    def _missing(self) -> list[int]:
        """List the active robots whose command is due."""
        return [
            robot
            for robot, time in enumerate(self._heard.published_at)
            if time != self._given_up[robot] and self._heard.now - time >= self._period
        ]


class Paced:
    """Waits for the wall clock; see :class:`TickEnd` and :func:`end_of_ticks`."""

    def __init__(
        self, settings: BridgeSettings, link: Link, heard: LastValue, look: Callable[[], None]
    ) -> None:
        self._settings, self._link, self._heard, self._look = settings, link, heard, look
        self._before = (0, time.monotonic())  # simulated [ns] and wall-clock time [s]

    def until_done(self) -> None:
        """See :class:`TickEnd`; time that the simulator took itself is not made up for."""
        now, (then, wall) = self._heard.now, self._before
        until = max(wall + (now - then) / NANO / self._settings.rate, time.monotonic())
        self._link.take()
        while time.monotonic() < until:
            self._look()
            self._link.wait(min(until, time.monotonic() + SLICE))
        self._before = now, until


def done_topic(name: str) -> Topic:
    """Give the topic on which a clock is acknowledged."""
    return Topic(name, DONE_TYPE, Qos(), "done")
