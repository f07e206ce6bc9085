"""Whether a value may be written to a file and read again, told by looking at it as it is."""

from __future__ import annotations

import builtins
import dataclasses
import functools
import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from mrta_falsify.core.codec import Rule

T = TypeVar("T")
Check = Callable[[Any], bool]


def is_sound(value: T, known: T | None = None) -> bool:
    """Say whether ``decode`` is sure to take what ``encode`` makes of a dataclass.

    Where it is not sure it says no; ``decode`` then tells, and what is wrong.

    Args:
        value: a dataclass of this project.
        known: one of its class that ``decode`` takes; objects that both share are not looked at.
    """
    kind: Any = type(value)
    for name, check in _fields(kind):
        part = getattr(value, name)
        if known is not None:
            before = getattr(known, name)
            if part is before:
                continue
            part = _without(before, part)
        if not check(part):
            return False
    return True


def _without(known: Any, value: Any) -> Any:
    """Leave those objects out of a tuple that are in another one."""
    if type(value) is not tuple or type(known) is not tuple:
        return value
    seen = set(map(id, known))
    return tuple(item for item in value if id(item) not in seen)


@functools.cache
def _fields(kind: Any) -> list[tuple[str, Check]]:
    hints = typing.get_type_hints(kind)
    return [
        (field.name, _check_of(hints[field.name], field.metadata.get("rule", Rule())))
        for field in dataclasses.fields(kind)
    ]


@functools.cache
def _check_of(hint: Any, rule: Rule) -> Check:
    """Make the check of a type hint under a rule."""
    if hint is Any:
        return lambda value: True
    if hint in (str, bool):
        return lambda value: type(value) is hint
    if hint in (float, int):
        allowed = (float, int) if hint is float else (int,)
        return lambda value: type(value) in allowed and not rule.violation(value)
    if dataclasses.is_dataclass(hint):
        fields = _fields(typing.cast(Any, hint))
        return lambda value: (
            type(value) is hint and all(check(getattr(value, name)) for name, check in fields)
        )
    given = typing.get_args(hint)
    match typing.get_origin(hint) or hint:
        case typing.Literal:
            return lambda value: type(value) in (str, int) and value in given
        case builtins.tuple if given[1:] == (Ellipsis,):
            item = _check_of(given[0], rule)
            return lambda value: type(value) is tuple and all(map(item, value))
        case builtins.dict:
            item = _check_of(given[1], rule)
            return lambda value: type(value) is dict and all(map(item, value.values()))
        case np.ndarray:
            return functools.partial(_is_sound_array, rule)
        case typing.Union | types.UnionType:
            return _check_of_union(given, rule)
    return lambda value: False


def _check_of_union(options: tuple[Any, ...], rule: Rule) -> Check:
    parts = [option for option in options if option is not type(None)]
    if len(parts) > 1 and not all(hasattr(part, "KIND") for part in parts):
        return lambda value: False
    checks = [_check_of(part, rule) for part in parts]
    may_be_none = len(parts) < len(options)
    return lambda value: may_be_none if value is None else any(check(value) for check in checks)


def _is_sound_array(rule: Rule, value: Any) -> bool:
    is_read_so = type(value) is np.ndarray and value.dtype == np.float64
    return is_read_so and rule.fits(value.shape) and not rule.violation(value)
