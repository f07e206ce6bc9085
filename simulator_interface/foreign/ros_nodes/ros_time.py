"""``rclpy.time``, ``duration``, ``clock`` and ``timer``: all clocks show simulated time."""

from __future__ import annotations

import enum
import functools
from collections.abc import Callable
from typing import Any

from simulator_interface.foreign.ros_nodes import here
from simulator_interface.foreign.ros_nodes.fibres import NS
from simulator_interface.foreign.ros_nodes.ros_messages import message_class


class ClockType(enum.IntEnum):
    """Which clock; all of them show simulated time."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


@functools.total_ordering
class Duration:
    """A span of time."""

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        self.nanoseconds = int(seconds * NS) + int(nanoseconds)

    @classmethod
    def from_msg(cls, message: Any) -> Duration:
        """Read ``builtin_interfaces/msg/Duration``."""
        return cls(nanoseconds=message.sec * NS + message.nanosec)

    def to_msg(self) -> Any:
        """Give ``builtin_interfaces/msg/Duration``."""
        sec, nanosec = divmod(self.nanoseconds, NS)
        return message_class("builtin_interfaces/msg/Duration")(sec=sec, nanosec=nanosec)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Duration) and self.nanoseconds == other.nanoseconds

    def __lt__(self, other: Duration) -> bool:
        return self.nanoseconds < other.nanoseconds

    def __hash__(self) -> int:
        return hash(self.nanoseconds)

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self.nanoseconds})"


@functools.total_ordering
class Time:
    """A point in time."""

    def __init__(
        self,
        *,
        seconds: float = 0,
        nanoseconds: int = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        self.nanoseconds = int(seconds * NS) + int(nanoseconds)
        self.clock_type = clock_type

    @classmethod
    def from_msg(cls, message: Any, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        """Read ``builtin_interfaces/msg/Time``."""
        return cls(nanoseconds=message.sec * NS + message.nanosec, clock_type=clock_type)

    def to_msg(self) -> Any:
        """Give ``builtin_interfaces/msg/Time``."""
        sec, nanosec = divmod(self.nanoseconds, NS)
        return message_class("builtin_interfaces/msg/Time")(sec=sec, nanosec=nanosec)

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Give whole seconds, and the nanoseconds left."""
        return divmod(self.nanoseconds, NS)

    def __add__(self, other: object) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        return Time(nanoseconds=self.nanoseconds + other.nanoseconds, clock_type=self.clock_type)

    __radd__ = __add__

    def __sub__(self, other: object) -> Any:
        if isinstance(other, Duration):
            left = self.nanoseconds - other.nanoseconds
            return Time(nanoseconds=left, clock_type=self.clock_type)
        if isinstance(other, Time):
            self._same_clock(other)
            return Duration(nanoseconds=self.nanoseconds - other.nanoseconds)
        return NotImplemented

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Time):
            return NotImplemented
        self._same_clock(other)
        return self.nanoseconds == other.nanoseconds

    def __lt__(self, other: Time) -> bool:
        self._same_clock(other)
        return self.nanoseconds < other.nanoseconds

    def __hash__(self) -> int:
        return hash((self.nanoseconds, self.clock_type))

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self.nanoseconds}, clock_type={self.clock_type.name})"

    def _same_clock(self, other: Time) -> None:
        if self.clock_type != other.clock_type:
            raise TypeError("Can't compare or subtract times with different clock types")


class Clock:
    """Shows simulated time."""

    def __init__(self, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> None:
        self.clock_type = clock_type

    def now(self) -> Time:
        """Give the time."""
        return Time(nanoseconds=here.timeline().now, clock_type=self.clock_type)

    def sleep_until(self, until: Time, context: Any = None) -> bool:
        """Wait until a time."""
        timeline = here.timeline()
        timeline.sleep(max(0, until.nanoseconds - timeline.now))
        return True

    def sleep_for(self, span: Duration, context: Any = None) -> bool:
        """Wait for a while."""
        here.timeline().sleep(max(0, span.nanoseconds))
        return True


class ROSClock(Clock):
    """The clock of a node."""

    def __init__(self) -> None:
        super().__init__(clock_type=ClockType.ROS_TIME)


class Timer:
    """Calls back at a period; missed calls are skipped, as ``rcl_timer_call`` does.

    Args:
        callback: to be called.
        group: of callbacks.
        period: [ns].
        clock: of the node.
        notify: called when it becomes ready.
    """

    def __init__(
        self,
        callback: Callable[[], object],
        group: Any,
        period: int,
        clock: Clock,
        notify: Callable[[], None],
    ) -> None:
        self.callback, self.callback_group, self.clock = callback, group, clock
        self.timer_period_ns = period
        self._notify = notify
        self._timeline = here.timeline()
        self._last = self._timeline.now
        self._is_cancelled = False
        self._alarms = 0
        self._next = 0
        self.reset()

    def reset(self) -> None:
        """Start anew from now."""
        self._is_cancelled = False
        self._next = self._timeline.now + self.timer_period_ns
        self._set_alarm()

    def cancel(self) -> None:
        """Stop it until it is reset."""
        self._is_cancelled = True

    destroy = cancel

    def is_canceled(self) -> bool:
        """Tell whether it was cancelled."""
        return self._is_cancelled

    def is_ready(self) -> bool:
        """Tell whether a call is due."""
        return not self._is_cancelled and self._timeline.now >= self._next

    def time_since_last_call(self) -> int:
        """Give the time since the last call [ns]."""
        return self._timeline.now - self._last

    def time_until_next_call(self) -> int | None:
        """Give the time until the next call [ns]; None: it was cancelled."""
        return None if self._is_cancelled else self._next - self._timeline.now

    def take(self) -> Callable[[], object]:
        """Give the call that is due, and set the next one."""
        now = self._timeline.now
        self._last = now
        self._next += self.timer_period_ns
        if self._next < now:
            period = self.timer_period_ns
            self._next = (
                now if period == 0 else self._next + -((self._next - now) // period) * period
            )
        self._set_alarm()
        return self.callback

    def _set_alarm(self) -> None:
        self._alarms += 1
        number = self._alarms
        due = max(self._next, self._timeline.now + 1)  # a period of 0 must let time go on
        self._timeline.at(due, lambda: self._ring(number))

    def _ring(self, number: int) -> None:
        if number == self._alarms and not self._is_cancelled:
            self._notify()


class Rate:
    """Sleeps to a period."""

    def __init__(self, period: int, clock: Clock) -> None:
        self._period, self._clock = period, clock
        self._timeline = here.timeline()
        self._next = self._timeline.now + period

    def sleep(self) -> None:
        """Wait for the end of the period."""
        now = self._timeline.now
        if self._next <= now:
            self._next += ((now - self._next) // self._period + 1) * self._period
        self._timeline.sleep(self._next - now)
        self._next += self._period

    def destroy(self) -> None:
        """End it."""
