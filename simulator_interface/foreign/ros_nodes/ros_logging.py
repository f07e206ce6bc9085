"""``rclpy.logging``: lines of a node, kept with the simulated time."""

from __future__ import annotations

import enum
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulator_interface.foreign.ros_nodes.ros_programs import RunningProgram

from simulator_interface.foreign.ros_nodes.fibres import NS


class LoggingSeverity(enum.IntEnum):
    """How grave a line is."""

    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50


class Logger:
    """Writes lines of one node.

    Args:
        program: the node belongs to.
        name: of the node.
    """

    def __init__(self, program: RunningProgram, name: str) -> None:
        self.name = name
        self._program = program
        self._level = LoggingSeverity.INFO
        self._last: dict[tuple[str, int], int] = {}  # when a line of code last wrote [ns]

    def get_child(self, name: str) -> Logger:
        """Give the log of a part."""
        return Logger(self._program, f"{self.name}.{name}")

    def set_level(self, level: int) -> None:
        """Leave out what is less grave."""
        self._level = LoggingSeverity(level)

    def get_effective_level(self) -> LoggingSeverity:
        """Give the least gravity that is written."""
        return self._level

    def is_enabled_for(self, level: int) -> bool:
        """Tell whether lines of a gravity are written."""
        return level >= self._level

    def log(self, message: object, severity: int, **how: Any) -> bool:
        """Write a line; ``once``, ``skip_first`` and ``throttle_duration_sec`` hold per place."""
        if severity < self._level or not self._is_due(how):
            return False
        self._program.log(LoggingSeverity(severity).name.lower(), self.name, str(message))
        return True

    def debug(self, message: object, **how: Any) -> bool:
        """Write what helps to find faults."""
        return self.log(message, LoggingSeverity.DEBUG, **how)

    def info(self, message: object, **how: Any) -> bool:
        """Write what is usual."""
        return self.log(message, LoggingSeverity.INFO, **how)

    def warning(self, message: object, **how: Any) -> bool:
        """Write what is unusual."""
        return self.log(message, LoggingSeverity.WARN, **how)

    warn = warning

    def error(self, message: object, **how: Any) -> bool:
        """Write what went wrong."""
        return self.log(message, LoggingSeverity.ERROR, **how)

    def fatal(self, message: object, **how: Any) -> bool:
        """Write what ends the program."""
        return self.log(message, LoggingSeverity.FATAL, **how)

    def _is_due(self, how: dict[str, Any]) -> bool:
        if not how:
            return True
        frame = sys._getframe(3)
        place, now = (frame.f_code.co_filename, frame.f_lineno), self._program.timeline.now
        last = self._last.get(place)
        throttle = how.get("throttle_duration_sec")
        if last is None:
            self._last[place] = now
            return not how.get("skip_first")
        if how.get("once"):
            return False
        if throttle is not None and now - last < throttle * NS:
            return False
        self._last[place] = now
        return True
