"""The programs of a stack: what would be an operating system process each, all in this one.

A program has its own copies of the user's modules, its own command line, parameters and log. Its
modules see simulated time, and threads that run on it (:mod:`private_modules`).
"""

from __future__ import annotations

import importlib
import sys
import traceback
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from simulator_interface.foreign.ros_nodes.fibres import NS, Timeline
from simulator_interface.foreign.ros_nodes.private_modules import PrivateModules

LAST_LINES = 200  # of a program's log that are kept


@dataclass(frozen=True, kw_only=True)
class Launch:
    """How a program is started.

    Args:
        name: of the program.
        target: ``module:function``.
        arguments: of its command line.
        parameters: of its nodes, by name, or by node and name.
        remappings: of topic, service and node names.
        namespace: of its nodes.
    """

    name: str
    target: str
    arguments: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    remappings: Mapping[str, str] = field(default_factory=dict)
    namespace: str = ""


@dataclass(frozen=True)
class Line:
    """One line of a log."""

    time: float  #: simulated [s]
    level: str
    source: str  #: a node, or the program
    text: str


class RunningProgram:
    """A program that has been started.

    Args:
        launch: how.
        timeline: it runs on.
        modules: that programs have to themselves.
    """

    _entered: RunningProgram | None = None  # whose modules are visible

    def __init__(self, launch: Launch, timeline: Timeline, modules: PrivateModules) -> None:
        self.launch = launch
        self.timeline = timeline
        self.is_dead = False
        self.error = ""  #: traceback, if it died
        self.nodes: list[Any] = []
        self.lines: deque[Line] = deque(maxlen=LAST_LINES)
        self.context: Any = None  #: of rclpy
        self.executor: Any = None  #: rclpy's global one
        self._modules = modules
        self._own: dict[str, ModuleType] = {}

    def start(self, after: float = 0.0) -> None:
        """Start it ``after`` [s] from now."""
        self.timeline.start(self, self._main, after=round(after * NS))

    def enter(self) -> None:
        """Make its modules and its command line visible."""
        last = RunningProgram._entered
        if last is self:
            return
        if last is not None:
            last._leave()
        RunningProgram._entered = self
        self._modules.owned = self._own
        sys.modules.update(self._own)
        sys.argv = [self.launch.name, *self.launch.arguments]

    def _leave(self) -> None:
        for name in self._own:
            sys.modules.pop(name, None)

    def fail(self, error: BaseException) -> None:
        """Take note that it has died."""
        self.error = "".join(traceback.format_exception(error))
        self.is_dead = True
        self.log("fatal", self.launch.name, self.error)

    def log(self, level: str, source: str, text: str) -> None:
        """Keep a line; print it if it is a warning or worse."""
        line = Line(self.timeline.now / NS, level, source, text)
        self.lines.append(line)
        if level in ("warn", "error", "fatal"):
            print(f"[{line.time:.3f}] [{level}] [{source}] {text}", flush=True)

    def _main(self) -> None:
        module, _, function = self.launch.target.partition(":")
        main: Callable[[], object] = getattr(importlib.import_module(module), function)
        main()


def start_all(
    launches: Sequence[Launch],
    timeline: Timeline,
    modules: PrivateModules,
    phases: Mapping[str, float],
) -> list[RunningProgram]:
    """Start programs, each its phase [s] late, for processes do not start at one moment."""
    programs = [RunningProgram(launch, timeline, modules) for launch in launches]
    for program in programs:
        program.start(phases.get(program.launch.name, 0.0))
    return programs
