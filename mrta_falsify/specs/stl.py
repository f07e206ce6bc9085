"""User formulas in signal temporal logic, over the signals of :mod:`mrta_falsify.specs.signals`.

``sentil`` is behind this door: nothing of it shows in names, errors or values.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import sentil

from mrta_falsify.core.errors import ConfigError, UnknownNameError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.signals import FLEET, NEED_GOALS, ROBOT, SignalReader

BOUND = 1e6  # robustness beyond this (an empty window gives infinity) is cut, to stay JSON
FUNCTIONS = ("abs", "sqrt", "exp", "ln", "log", "sin", "cos", "tan", "floor", "ceil", "min", "max")
KEYWORDS = (
    *("always", "eventually", "historically", "once", "next", "until", "since", "not"),
    *("and", "or", "implies", "G", "F", "X", "U", "H", "O", "S"),
)
ROBOT_SIGNAL = re.compile(r"\b(?P<name>" + "|".join(ROBOT) + r")\(\s*(?P<robot>[^()\s]+)\s*\)")
CALL = re.compile(r"\b([A-Za-z_]\w*)\s*\(")
ON_A_TICK = 1e-6  # ticks by which a bound may miss a tick and still mean it


class StlSpecification:
    """A formula of the user's own.

    Syntax: ``always``, ``eventually``, ``until``, ``historically``, ``once``, ``since`` with
    optional windows ``[a, b]`` in seconds. They combine by ``and``, ``or``, ``not``, ``->`` over
    comparisons of arithmetic over signals, for example
    ``always (d_human > 0.5 or speed(robot1) < 0.2)``.
    The formula is judged at time 0. Windows are cut where the episode ends. Robustness is in
    the unit of the comparison that decides.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """The formula."""

        formula: str
        name: str = ""  #: shown in reports; empty: ``stl:`` and the formula

    def __init__(self, options: Options) -> None:
        self._text = options.formula.removeprefix("stl:").strip()
        self._name = options.name or f"stl:{self._text}"
        plain, self._robot_signals = _without_calls(self._text)
        self._formula = _parse(plain, self._text)

    def start(self, world: World, dt: float) -> None:
        """Begin an episode.

        Raises:
            UnknownNameError: the formula names a robot that the world does not have.
        """
        numbers = {robot.name: i for i, robot in enumerate(world.robots)}
        for _, robot in self._robot_signals.values():
            if robot not in numbers:
                raise UnknownNameError("robot", robot, numbers, where=self._name)
        wanted = sorted(self._formula.variables)
        of_robots = [name for name in wanted if name in self._robot_signals]
        of_fleet = [name for name in wanted if name in FLEET]
        self._extra = tuple(name for name in wanted if name not in {*of_robots, *of_fleet})
        pairs = [self._robot_signals[name] for name in of_robots]
        self._reader = SignalReader(
            world,
            fleet=tuple(of_fleet),
            robot=tuple((signal, numbers[robot]) for signal, robot in pairs),
            extra=self._extra,
        )
        named = {*of_fleet, *(signal for signal, _ in pairs)}
        self._needed = ("goals",) if named & NEED_GOALS else ()
        self._missing = ""
        self._columns = (*of_fleet, *of_robots, *self._extra)
        self._scaled = _in_ticks(self._formula, dt)
        # Lists, not arrays: the engine reads them five times as fast.
        self._values: dict[str, list[float]] = {name: [] for name in self._columns}
        self._ticks: list[float] = []
        self._times: list[float] = []
        self._world, self._dt = world, dt
        self._monitor = _monitor(self._scaled)
        self._decided: float | None = None

    def update(self, frame: Frame) -> None:
        """Take in one tick.

        Raises:
            UnknownNameError: the formula names a signal that nobody provides.
        """
        self._missing = frame.tells.lacking(*self._needed)
        try:
            row = dict(zip(self._columns, self._reader.read(frame), strict=True))
        except KeyError:
            missing = next(name for name in self._extra if name not in frame.signals)
            known = [*FLEET, *(f"{name}(ROBOT)" for name in ROBOT), *frame.signals]
            raise UnknownNameError("signal", missing, known, where=self._name) from None
        for name, value in row.items():
            self._values[name].append(value)
        self._ticks.append(float(len(self._ticks)))
        self._times.append(frame.sensed.time)
        self._watch(row)

    def _watch(self, row: dict[str, float]) -> None:
        """Notice the first tick after which no continuation could satisfy the formula."""
        if self._monitor is None:
            return
        try:
            known = self._monitor.update(self._ticks[-1], row)
        except sentil.SentilError:
            self._monitor = None  # the engine cannot evaluate it here; the verdict will say why
            return
        if known.upper < 0.0:
            self._decided = self._times[-1]
        if known.upper < 0.0 or known.lower >= 0.0:
            self._monitor = None  # later answers are about later times, not about time 0

    def verdict(self) -> Verdict:
        """Give the verdict to date, on the signals seen so far.

        A formula that the rest of the episode could still satisfy is violated by what was seen
        if its robustness is below 0, but at no time yet.
        """
        if self._missing:
            return unjudged(self._name, self._missing)
        if not self._times:
            return Verdict(spec=self._name, robustness=0.0, violated=False)
        try:
            signals: dict[str, object] = {**self._values}
            value = float(self._scaled.robustness(sentil.Trace(self._ticks, signals)))
        except sentil.SentilError as error:
            raise ConfigError(f"{self._name}: {error}") from None
        if np.isnan(value):
            raise ConfigError(
                f"{self._name}: the formula gives not-a-number; look for sqrt or log of negatives"
            )
        value = float(np.clip(value, -BOUND, BOUND))
        violated_at = self._violated_at() if value < 0.0 else None
        return Verdict(
            spec=self._name,
            robustness=value,
            violated=value < 0.0,
            violated_at=violated_at,
            who=tuple(sorted({robot for _, robot in self._robot_signals.values()}))
            if value < 0.0
            else (),
            evidence={"formula": self._text, "signals": self._signals_at(violated_at)},
        )

    def _violated_at(self) -> float | None:
        if self._decided is not None:
            return self._decided
        return self._times[-1] if self._world.is_over(self._times[-1], self._dt) else None

    def _signals_at(self, time: float | None) -> dict[str, float]:
        if time is None:
            return {}
        tick = self._times.index(time)
        shown = {
            name: f"{signal}({robot})" for name, (signal, robot) in self._robot_signals.items()
        }
        return {shown.get(name, name): column[tick] for name, column in self._values.items()}


def _without_calls(text: str) -> tuple[str, dict[str, tuple[str, str]]]:
    """Write ``speed(robot1)`` in ``text`` as ``speed_robot1_``: the engine has no such calls.

    Both are equally long, so that columns in error messages stay true.

    Returns:
        The text, and the (signal, robot) that each new name stands for.

    Raises:
        ConfigError: a call of something unknown, or two robots whose names would collide.
    """
    meaning: dict[str, tuple[str, str]] = {}

    def replace(match: re.Match[str]) -> str:
        name = re.sub(r"\W", "_", match.group(0))
        pair = (match["name"], match["robot"])
        if meaning.setdefault(name, pair) != pair:
            raise ConfigError(
                f"stl formula {text!r}: robots {pair[1]!r} and {meaning[name][1]!r} cannot be told "
                "apart; their names must differ in letters or digits"
            )
        return name

    plain = ROBOT_SIGNAL.sub(replace, text)
    for call in CALL.finditer(plain):
        if call[1] not in (*FUNCTIONS, *KEYWORDS, *meaning):
            known = (*ROBOT, *FUNCTIONS)
            where = f"stl formula {text!r}, column {call.start() + 1}"
            raise UnknownNameError("signal or function", call[1], known, where=where)
    return plain, meaning


def _parse(plain: str, text: str) -> sentil.Formula:
    try:
        formula = sentil.Formula.parse(plain)
    except sentil.SentilError as error:
        detail = str(error).removeprefix("parse error at ").removeprefix("line 1, ")
        raise ConfigError(
            f"stl formula {text!r}: {detail}; "
            "write for example `always (d_human > 0.5)`, see docs/specifications.md"
        ) from None
    if "Probab" in formula.to_json():
        raise ConfigError(
            f"stl formula {text!r}: the operator P is not allowed; a run has no probabilities"
        )
    return formula


def _monitor(formula: sentil.Formula) -> sentil.OnlineMonitor | None:
    """Build an online monitor; None for a future inside a past, which is judged at the end."""
    try:
        return sentil.OnlineMonitor(formula)
    except sentil.SemanticError:
        return None


def _in_ticks(formula: sentil.Formula, dt: float) -> sentil.Formula:
    """Count the windows of ``formula`` in ticks, so that no rounding of times matters."""
    return sentil.Formula.from_json(json.dumps(_scaled(json.loads(formula.to_json()), dt)))


def _scaled(node: Any, dt: float) -> Any:
    if isinstance(node, dict):
        if set(node) == {"lower", "upper"}:
            return {key: _ticks(value, dt) for key, value in node.items()}
        return {key: _scaled(item, dt) for key, item in node.items()}
    if isinstance(node, list):
        return [_scaled(item, dt) for item in node]
    return node


def _ticks(seconds: float | None, dt: float) -> float | None:
    if seconds is None:
        return None
    ticks = seconds / dt
    nearest = float(round(ticks))
    return nearest if abs(ticks - nearest) <= ON_A_TICK * max(1.0, nearest) else ticks
