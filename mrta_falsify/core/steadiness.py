"""What decides the future of a run, as numbers: equal at two moments but for the time that passed.

A deterministic run whose memory is the same at two moments, apart from clocks that went on with it,
repeats what lay between them for as long as nothing timed happens. If nothing moved in between,
nothing ever moves again.
"""

from __future__ import annotations

import collections
import dataclasses
import enum
import functools
import hashlib
import types
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import World

#: fields that hold moments at which something was planned, or will be again: a stack at rest may
#: plan again and again. How long that takes is bounded by its longest timer
MOMENTS = frozenset(("time", "plan_at", "replan_at", "not_before"))
STEPS_PER_TICK = 100  # at most, of an engine that counts them
CADENCE = 1.0  # s; stamps that are renewed again and again are renewed at least this often
#: what holds no state that decides, or state that the run only reads
CONSTANT = (World, type, types.FunctionType, types.BuiltinFunctionType, types.ModuleType)


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """All that decides the next ticks of a run."""

    rest: str  #: hash of everything that is no number: names, shapes, the order of things
    numbers: Array  #: ``(K,)`` numbers in the order in which they were found
    opaque: frozenset[str]  #: names of types whose state cannot be read

    def is_same_but_for_time(self, earlier: Memory, seconds: float, ticks: int) -> bool:
        """Whether nothing differs from ``earlier`` but clocks.

        Args:
            earlier: memory of the same run.
            seconds: simulated time since then [s].
            ticks: control ticks since then.

        Returns:
            True where each number is the same, bit for bit, or has grown by the time that passed:
            by the seconds, or by the same number at each tick. False where an object keeps state
            that cannot be read.
        """
        if self.opaque or self.rest != earlier.rest or len(self.numbers) != len(earlier.numbers):
            return False
        now, then = self.numbers, earlier.numbers
        same = (now == then) | (np.isnan(now) & np.isnan(then))
        grown = np.where(same, 0.0, np.nan_to_num(now) - np.nan_to_num(then))
        steps = grown / ticks
        counts = (steps == np.round(steps)) & (steps >= 1.0) & (steps <= STEPS_PER_TICK)
        is_clock = (np.abs(grown - seconds) <= CADENCE) | counts
        return bool((same | is_clock).all())


def memory_of(*parts: object) -> Memory:
    """Read the memory of objects: every number that they hold, directly or through others.

    Args:
        parts: for example the state of a stack, an engine, people. Worlds and functions count as
            constant.
    """
    reader = _Reader()
    for part in parts:
        reader.read(part)
    numbers = np.concatenate(reader.numbers) if reader.numbers else np.zeros(0)
    return Memory(reader.rest.hexdigest(), numbers, frozenset(reader.opaque))


class _Reader:
    """Walks through objects, each once."""

    def __init__(self) -> None:
        self.rest = hashlib.sha256()
        self.numbers: list[Array] = []
        self.opaque: set[str] = set()
        self._seen: dict[int, int] = {}
        self._kept: list[object] = []  # so that no id is used twice

    def read(self, value: object) -> None:
        if value is None or isinstance(value, (bool, str, bytes, enum.Enum, np.bool_)):
            self._note(repr(value))
        elif isinstance(value, (int, float, np.number)):
            self.numbers.append(np.array([value], dtype=np.float64))
        elif isinstance(value, CONSTANT) or _is_compiled(value):
            self._note(getattr(value, "__qualname__", type(value).__qualname__))
        elif id(value) in self._seen:
            self._note(f"again {self._seen[id(value)]}")
        else:
            self._seen[id(value)] = len(self._seen)
            self._kept.append(value)
            self._note(type(value).__qualname__)
            self._read_inside(value)

    def _read_inside(self, value: Any) -> None:
        if isinstance(value, np.ndarray):
            self._read_array(value)
        elif isinstance(value, np.random.Generator):
            self._note(repr(value.bit_generator.state))
        elif isinstance(value, dict):
            for key in value:
                self._note(repr(key))
                self.read(value[key])
        elif isinstance(value, (set, frozenset)):
            self._note(repr(sorted(map(repr, value))))
        elif isinstance(value, (list, tuple, collections.deque)):
            self._note(str(len(value)))
            for item in value:
                self.read(item)
        elif isinstance(value, functools.partial):
            self.read((value.func, value.args, value.keywords))
        elif isinstance(value, types.MethodType):
            self._note(value.__func__.__qualname__)
            self.read(value.__self__)
        else:
            self._read_fields(value)

    def _read_array(self, value: np.ndarray[Any, Any]) -> None:
        self._note(repr((value.dtype.str, value.shape)))
        if value.dtype.names:
            for name in value.dtype.names:
                self.read(np.ascontiguousarray(value[name]))
        elif value.dtype.kind in "fiu":
            self.numbers.append(value.astype(np.float64).ravel())
        elif value.dtype == object:
            for item in value.ravel():
                self.read(item)
        else:
            self._note(hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest())

    def _read_fields(self, value: object) -> None:
        names = list(dict.fromkeys(_field_names(value)))
        if not names and not _is_ours(value):
            self.opaque.add(f"{type(value).__module__}.{type(value).__qualname__}")
            return
        for name in names:
            if hasattr(value, name):
                self._note(name)
                inside = getattr(value, name)
                if not (name in MOMENTS and isinstance(inside, (int, float))):
                    self.read(inside)

    def _note(self, text: str) -> None:
        self.rest.update(text.encode() + b"\0")


def _field_names(value: object) -> Iterator[str]:
    if dataclasses.is_dataclass(value):
        yield from (field.name for field in dataclasses.fields(value))
    for kind in type(value).__mro__:
        slots = kind.__dict__.get("__slots__", ())
        yield from (slots,) if isinstance(slots, str) else slots
    yield from getattr(value, "__dict__", ())


def _is_ours(value: object) -> bool:
    return type(value).__module__.partition(".")[0] in ("mrta_falsify", "simulator_interface")


def _is_compiled(value: object) -> bool:
    return type(value).__module__.startswith("numba.")
