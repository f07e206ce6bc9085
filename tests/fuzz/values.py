"""Data from the codec's own types: valid ones, and ones with a mistake that must be refused.

``valid`` follows the type hints and rules of a dataclass, as ``codec.decode`` does. ``spoiled``
puts one mistake into valid data, and says where. The mistakes of a field are derived from its type
and rule, so a new field of a new class is tried without a line here.
"""

from __future__ import annotations

import builtins
import copy
import dataclasses
import enum
import math
import random
import types
import typing
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.codec import Rule

NAMES = ("a", "robot1", "Zimmer 4", "na\u00efve", "\U0001f916", "x" * 80)
HUGE = 10**400
DEEPEST = 6  # levels of optional parts


@dataclass(frozen=True)
class Site:
    """A place in data, and what the codec expects there."""

    path: tuple[str | int, ...]
    hint: Any
    rule: Rule | None


def valid(hint: Any, rule: Rule | None, rnd: random.Random, depth: int = 0) -> Any:
    """Make JSON-shaped data of a type, each value within its own rule."""
    if hint is Any:
        return rnd.choice([None, True, 3, 1.5, "text", [1, "a"], {"b": 2.0}])
    if hint is str:
        return rnd.choice(NAMES)
    if hint is bool:
        return rnd.random() < 0.5
    if hint is int:
        return _number(rule, rnd, whole=True)
    if hint is float:
        return _number(rule, rnd, whole=rnd.random() < 0.2)
    if dataclasses.is_dataclass(hint):
        return _object(hint, rnd, depth)
    given = typing.get_args(hint)
    match typing.get_origin(hint) or hint:
        case typing.Union | types.UnionType:
            parts = [part for part in given if part is not types.NoneType]
            if len(parts) < len(given) and (depth > DEEPEST or rnd.random() < 0.5):
                return None
            return valid(rnd.choice(parts), rule, rnd, depth)
        case typing.Literal:
            return rnd.choice(given)
        case builtins.tuple if given[1:] == (Ellipsis,):
            count = 0 if depth > DEEPEST else rnd.randrange(3)
            return [valid(given[0], rule, rnd, depth + 1) for _ in range(count)]
        case builtins.tuple:
            return [valid(part, rule, rnd, depth + 1) for part in given]
        case builtins.dict:
            count = 0 if depth > DEEPEST else rnd.randrange(3)
            return {f"k{i}": valid(given[1], rule, rnd, depth + 1) for i in range(count)}
        case np.ndarray:
            return _array(rule or Rule(), rnd)
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return rnd.choice([item.value for item in hint])
    raise TypeError(f"no data of {hint!r}")


def _number(rule: Rule | None, rnd: random.Random, *, whole: bool) -> float:
    rule = rule or Rule()
    low = rule.low if rule.low is not None else rule.above if rule.above is not None else -1000.0
    high = rule.high if rule.high is not None else max(low, 0.0) + 1000.0
    if whole and math.floor(high) > low:
        return rnd.randint(math.floor(low) + 1, math.floor(high))
    return low + (high - low) * rnd.uniform(0.01, 1.0)


def _array(rule: Rule, rnd: random.Random) -> Any:
    lengths: dict[str, int] = {}
    shape = [
        lengths.setdefault(n, rnd.randint(1, 4)) if isinstance(n, str) else n
        for n in rule.shape or (2,)
    ]

    def filled(dimensions: list[int]) -> Any:
        if not dimensions:
            return _number(rule, rnd, whole=rnd.random() < 0.2)
        return [filled(dimensions[1:]) for _ in range(dimensions[0])]

    return filled(shape)


def _object(cls: Any, rnd: random.Random, depth: int) -> dict[str, Any]:
    hints = typing.get_type_hints(cls)
    made = {}
    for field in dataclasses.fields(cls):
        is_needed = (
            field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        )
        if field.name != "kind" and not is_needed and (depth > DEEPEST or rnd.random() < 0.4):
            continue
        made[field.name] = valid(hints[field.name], field.metadata.get("rule"), rnd, depth + 1)
    return made


# --- mistakes --------------------------------------------------------------------------------


def sites(hint: Any, rule: Rule | None, data: Any, path: tuple[Any, ...] = ()) -> list[Site]:
    """List all places in valid data, the whole of it first."""
    found = [Site(path, hint, rule)]
    given = typing.get_args(hint)
    if data is None or hint is Any:
        return found
    if dataclasses.is_dataclass(hint):
        hints = typing.get_type_hints(hint)
        for field in dataclasses.fields(hint):
            if field.name in data:
                inside, name = field.metadata.get("rule"), field.name
                found += sites(hints[name], inside, data[name], (*path, name))
        return found
    match typing.get_origin(hint) or hint:
        case typing.Union | types.UnionType:
            parts = [part for part in given if part is not types.NoneType]
            part = parts[0]
            if len(parts) > 1:
                part = next(p for p in parts if getattr(p, "KIND", None) == data.get("kind"))
            return [found[0], *sites(part, rule, data, path)[1:]]
        case builtins.tuple:
            for i, item in enumerate(data):
                part = given[0] if given[1:] == (Ellipsis,) else given[i]
                found += sites(part, rule, item, (*path, i))
        case builtins.dict:
            for key, item in data.items():
                found += sites(given[1], rule, item, (*path, key))
    return found


def mistakes(site: Site, data: Any, rnd: random.Random) -> Any:
    """Give a value that must be refused at a site; ``MISSING``: there is none."""
    hint, rule, given = site.hint, site.rule, typing.get_args(site.hint)
    if hint is Any:
        odd = [HUGE, [-HUGE], {"a": [HUGE]}]
        return rnd.choice(odd if rule is None else [*odd, math.nan, [math.inf]])
    if hint is str:
        return rnd.choice([3, 1.5, True, None, [], {}, ["a"], HUGE])
    if hint is bool:
        return rnd.choice([0, 1, 1.0, "true", "", None, [], {}])
    if hint in (int, float):
        odd = ["1", "", "nan", True, False, None, [], {}, [1], HUGE, -HUGE, math.nan, math.inf]
        odd += [-math.inf, 1e308, *_beyond(rule or Rule()), *([1.5] if hint is int else [])]
        return rnd.choice(odd)
    if dataclasses.is_dataclass(hint):
        return _spoiled_object(hint, data, rnd)
    match typing.get_origin(hint) or hint:
        case typing.Union | types.UnionType:
            parts = [part for part in given if part is not types.NoneType]
            if len(parts) == 1:
                odd = mistakes(Site(site.path, parts[0], rule), data, rnd)
                return dataclasses.MISSING if odd is None else odd
            return rnd.choice([3, "x", [], {}, {"kind": []}, {"kind": {}}, {"kind": None}])
        case typing.Literal:
            return rnd.choice(["no such choice", 3.5, None, [], {}, [given[0]], HUGE])
        case builtins.tuple:
            return rnd.choice([3, "ab", True, None, {}, {"0": 1}, HUGE])
        case builtins.dict:
            return rnd.choice([3, "ab", True, None, [], [1], HUGE])
        case np.ndarray:
            return _spoiled_array(rule or Rule(), data, rnd)
    return rnd.choice([None, [], {}, "no such choice"])


def _beyond(rule: Rule) -> list[float]:
    """List numbers just outside a rule."""
    found = [2.0 * rule.farthest, -2.0 * rule.farthest]
    found += [] if rule.low is None else [rule.low - 1, rule.low - 0.5]
    found += [] if rule.above is None else [rule.above, rule.above - 1]
    found += [] if rule.high is None else [rule.high + 1]
    return found


def _spoiled_array(rule: Rule, data: Any, rnd: random.Random) -> Any:
    whole = [3, "x", True, None, {}, {"a": 1}, [["a"]], [[1.0], [1.0, 2.0]], [[[[[[1.0]]]]]]]
    flat = copy.deepcopy(data)
    row = flat
    while isinstance(row, list) and row and isinstance(row[0], list):
        row = rnd.choice(row)
    if not isinstance(row, list) or not row or rnd.random() < 0.3:
        return rnd.choice(whole)
    odd = ["1.5", True, False, [1.0], {}, HUGE, -HUGE, 1e308, math.nan, math.inf, "nan"]
    odd += _beyond(rule) + ([] if rule.allow_missing else [None])
    row[rnd.randrange(len(row))] = rnd.choice(odd)
    return flat


def _spoiled_object(cls: Any, data: Any, rnd: random.Random) -> Any:
    needed = [
        field.name
        for field in dataclasses.fields(cls)
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    act = rnd.randrange(3)
    if not isinstance(data, dict):
        act = 2
    if act == 0 and not getattr(cls, "OPEN", False):
        return {**data, rnd.choice(["no such field", "", "__class__", "k" * 5000, "\u202e"]): 1}
    if act == 1 and needed:
        left = dict(data)
        del left[rnd.choice(needed)]
        return left
    return rnd.choice([3, "x", [], [1], True, None, HUGE])


def spoiled(hint: Any, rnd: random.Random) -> tuple[Any, Site]:
    """Make data of a dataclass with one mistake; give the data, and where the mistake is."""
    data = valid(hint, None, rnd)
    found = sites(hint, None, data)
    for _ in range(50):
        site = rnd.choice(found)
        odd = mistakes(site, at(data, site.path), rnd)
        if odd is not dataclasses.MISSING:
            return put(data, site.path, odd), site
    raise AssertionError(f"no mistake found for {hint}")


def at(data: Any, path: tuple[Any, ...]) -> Any:
    """Find what stands at a path."""
    for step in path:
        data = data[step]
    return data


def put(data: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Put a value at a path of a copy."""
    if not path:
        return value
    data = copy.deepcopy(data)
    at(data, path[:-1])[path[-1]] = value
    return data
