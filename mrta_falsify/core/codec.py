"""Frozen dataclasses to and from JSON-shaped data, with messages that name the field.

The type hints of a dataclass are its schema. ``quantity`` adds limits and array shapes to
a field; ``decode`` checks them and reports the first violation as
``world.json: robots[2].max_speed is -1.0 m/s; it must be > 0``.
"""

from __future__ import annotations

import builtins
import dataclasses
import enum
import functools
import hashlib
import itertools
import json
import math
import re
import reprlib
import sys
import types
import typing
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.parsing import Doubled, parse_json, parse_yaml, read_text
from mrta_falsify.core.spelling import did_you_mean

T = TypeVar("T")
Check = Callable[[Any], bool]

NEGATIVE_ZERO = re.compile(r"-0\.0(?![0-9e])")  # in JSON
FARTHEST = 1e9  # of a quantity in its unit, unless it says more: 30 years, a million km
LARGEST = 1e100  # of a plain number; products of two are finite
MAX_WHOLE = (1 << 63) - 1  # of a whole number
_SCALARS = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}


@dataclasses.dataclass(frozen=True, slots=True)
class Rule:
    """What a field allows beyond its type."""

    shape: tuple[int | str, ...] | None = None  #: array shape; letters match any length
    low: float | None = None  #: smallest value allowed
    above: float | None = None  #: values must be strictly greater
    high: float | None = None  #: largest value allowed
    #: largest magnitude of numbers that are not whole, where nothing nearer is said
    farthest: float = LARGEST
    unit: str = ""  #: written after the value in messages
    allow_infinite: bool = False
    allow_missing: bool = False  #: nan, and null in its place

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Whether an array may have this shape; an empty one need not have all dimensions."""
        wanted = shape if self.shape is None else self.shape
        if 0 in shape and any(isinstance(length, str) for length in wanted):
            return True
        return len(shape) == len(wanted) and all(
            isinstance(length, str) or length == given
            for length, given in zip(wanted, shape, strict=True)
        )

    def violation(self, value: Array | float) -> str:
        """Say why ``value`` is not allowed; empty if it is."""
        farthest = self.farthest
        if isinstance(value, np.ndarray):
            if not value.size:
                return ""
            least, most = float(value.min()), float(value.max())  # nan, if any number is
        else:
            least = most = value
            if isinstance(value, int):
                farthest = MAX_WHOLE
        is_finite = -math.inf < least and most < math.inf
        if not least <= most:  # nan
            return "" if self.allow_missing else "it must be finite"
        if not (is_finite or self.allow_infinite):
            return "it must be finite"
        if self.low is not None and least < self.low:
            return f"it must be >= {self.low:g}"
        if self.above is not None and least <= self.above:
            return f"it must be > {self.above:g}"
        if self.high is not None and most > self.high:
            return f"it must be <= {self.high:g}"
        if not is_finite or -farthest <= least <= most <= farthest:
            return ""
        return f"it must be <= {farthest:g}" if most > farthest else f"it must be >= -{farthest:g}"


def quantity(
    *,
    shape: tuple[int | str, ...] | None = None,
    low: float | None = None,
    above: float | None = None,
    high: float | None = None,
    unit: str = "",
    allow_infinite: bool = False,
    default: Any = dataclasses.MISSING,
    text: str = "",
    came_later: bool = False,
) -> Any:
    """Dataclass field with limits (see :class:`Rule`); an array default is copied and frozen.

    ``dict`` as default stands for an empty one. Numbers in a field of any shape must be finite.

    A field with ``text`` is an option of the command line, and ``text`` its help. One that
    ``came_later`` is written as :func:`later` says.
    """
    rule = Rule(shape, low, above, high, FARTHEST, unit, allow_infinite)
    metadata: dict[str, Any] = {"rule": rule, "text": text} if text else {"rule": rule}
    if came_later:
        metadata["later"] = True
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
    if default is dict:
        return dataclasses.field(default_factory=dict, metadata=metadata)
    if isinstance(default, (list, np.ndarray)):
        return dataclasses.field(
            default_factory=functools.partial(frozen_array, default), metadata=metadata
        )
    return dataclasses.field(default=default, metadata=metadata)


def later(default: Any) -> Any:
    """Declare a field that joined a schema later: while it has its default it is not written.

    Files and digests of values that do not use it stay as they were. ``dict`` stands for an empty
    one.
    """
    if default is dict:
        return dataclasses.field(default_factory=dict, metadata={"later": True})
    return dataclasses.field(default=default, metadata={"later": True})


# --- out -------------------------------------------------------------------------------


def encode(value: Any) -> Any:
    """Encode a value of this project as dicts, lists, str, numbers, bool and None."""
    kind: Any = type(value)
    fields = _fields_of(kind)
    if fields is not None:
        pairs = ((f, getattr(value, f.name)) for f in fields)
        return {f.name: encode(item) for f, item in pairs if not _is_left_out(f, item)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, dict):
        return {str(key): encode(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [encode(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


@functools.cache
def _fields_of(kind: type) -> tuple[dataclasses.Field[Any], ...] | None:
    """List the fields of a dataclass; None: it is none."""
    return dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else None


def _is_left_out(field: dataclasses.Field[Any], item: Any) -> bool:
    if "later" not in field.metadata:
        return False
    if field.default_factory is not dataclasses.MISSING:
        return not item
    return bool(item == field.default)


def canonical_json(value: Any) -> str:
    """Write one text per value: sorted keys, shortest round-trip floats, -0.0 as 0.0."""
    data = encode(value)
    text = _compact(data)
    return _compact(_without_negative_zero(data)) if NEGATIVE_ZERO.search(text) else text


def _compact(data: Any) -> str:
    return json.dumps(data, sort_keys=True, separators=(",", ":"))


def _without_negative_zero(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_negative_zero(item) for key, item in data.items()}
    if isinstance(data, list):
        return [_without_negative_zero(item) for item in data]
    if isinstance(data, float):
        return data + 0.0
    return data


def digest(value: Any) -> str:
    """Compute the sha256 (hex) of the canonical JSON of ``value``."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


def finite(data: Any) -> Any:
    """JSON-shaped ``data`` with null in place of NaN and infinity, which JSON cannot say."""
    if isinstance(data, dict):
        return {key: finite(item) for key, item in data.items()}
    if isinstance(data, list):
        return [finite(item) for item in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


# --- in --------------------------------------------------------------------------------


def decode(
    hint: type[T], data: Any, *, where: str = "input", path: str = "", rule: Rule | None = None
) -> T:
    """Build a value from JSON-shaped data.

    A dataclass with ``OPEN`` leaves out fields that it does not know. One with a method
    ``check_stored`` is asked whether what was read fits together.

    Args:
        hint: a dataclass of this project, or another type that a field of one may have.
        data: what :func:`read_json` or :func:`read_yaml` returned.
        where: file name that starts every error message.
        path: of ``data`` in the file, empty: the whole of it.
        rule: that a number or array follows.

    Returns:
        The value, arrays frozen.

    Raises:
        InputError: unknown, missing or ill-typed field, wrong shape, limit broken, NaN.
    """
    return typing.cast(T, _decode(hint, data, where, path, rule))


class FieldError(InputError):
    """A field has a value that it must not have.

    Args:
        where: file name.
        path: of the field, empty: the whole file.
        problem: what is wrong with it, and what is allowed.
    """

    def __init__(self, where: str, path: str, problem: str) -> None:
        super().__init__(f"{where}: {path or 'top level'} {problem}")
        self.path, self.problem = path, problem


def _fail(where: str, path: str, problem: str) -> typing.NoReturn:
    raise FieldError(where, path, problem)


class _Repr(reprlib.Repr):
    """Writes the beginning of data of any size and depth."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother, self.maxlong = 8, 70, 70, 70
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = 30

    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        """Write the first fields, in their order."""
        if level <= 0:
            return "{...}"
        first = list(x.items())[: self.maxdict]
        pairs = [f"{self.repr1(k, level - 1)}: {self.repr1(v, level - 1)}" for k, v in first]
        return "{" + ", ".join([*pairs, *["..."] * (len(x) > len(first))]) + "}"


_REPR = _Repr()


def shown(data: Any) -> str:
    """Write data into a message, in one line and cut short."""
    text = _REPR.repr(data)
    return text if len(text) <= 60 else text[:57] + "..."


def _decode(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    if rule is None and type(data) is hint and _is_plain(data):
        return data  # most of what is stored, at a fifth of the time
    if hint is Any:
        return _decode_anything(data, where, path, rule)
    if hint in _SCALARS:
        return _decode_scalar(hint, data, where, path, rule)
    origin = _origin(hint)
    if origin is _RECORD:
        return _decode_dataclass(typing.cast(type, hint), data, where, path)
    match origin:
        case typing.Union | types.UnionType:
            return _decode_union(hint, data, where, path, rule)
        case typing.Literal:
            return _decode_choice(_args(hint), data, where, path)
        case builtins.tuple:
            return _decode_tuple(hint, data, where, path, rule)
        case builtins.dict:
            return _decode_dict(hint, data, where, path, rule)
        case np.ndarray:
            return _decode_array(data, where, path, rule or Rule())
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return hint(_decode_choice(tuple(item.value for item in hint), data, where, path))
    raise TypeError(f"{hint!r} is no type that can be read from a file")


_RECORD = "a dataclass"


@functools.cache
def _origin(hint: Any) -> Any:
    """Tell what a type is made of, once for all values that have it."""
    return _RECORD if dataclasses.is_dataclass(hint) else typing.get_origin(hint) or hint


_args = functools.cache(typing.get_args)  # of a type


@functools.cache
def _alike(hint: Any) -> tuple[Any, ...]:
    """Give the scalar types of which a value that has one is of a type, if it is plain."""
    options = _args(hint) if _origin(hint) in (typing.Union, types.UnionType) else (hint,)
    known = [option for option in options if option is not type(None)]
    return tuple(known) if len(known) == 1 and known[0] in (float, str, bool) else ()


def _decode_anything(data: Any, where: str, path: str, rule: Rule | None) -> Any:
    """Refuse numbers that cannot be computed with, wherever they stand."""
    if isinstance(data, int) and abs(data) > MAX_WHOLE:
        _fail(where, path, f"is {shown(data)}; it must be from -{MAX_WHOLE} to {MAX_WHOLE}")
    if rule is not None and isinstance(data, float) and not math.isfinite(data):
        _fail(where, path, f"is {data}; it must be finite")
    sound = (str, bool, float) if rule is None else (str,)  # what is as good as it stands
    if isinstance(data, dict):
        for key, item in data.items():
            if type(item) not in sound:
                _decode_anything(item, where, _join(path, named(key)), rule)
    elif isinstance(data, (list, tuple)):
        for i, item in enumerate(data):
            if type(item) not in sound:
                _decode_anything(item, where, f"{path}[{i}]", rule)
    return data


def _decode_choice(allowed: tuple[Any, ...], data: Any, where: str, path: str) -> Any:
    for choice in allowed:
        if type(data) is type(choice) and data == choice:
            return choice
    names = ", ".join(map(repr, allowed))
    _fail(where, path, f"is {shown(data)}; it must be one of {names}")


def _is_plain(data: Any) -> bool:
    return -LARGEST <= data <= LARGEST if type(data) is float else type(data) in (str, bool)


def _decode_scalar(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    allowed = (float, int) if hint is float else hint
    if not isinstance(data, allowed) or (hint is not bool and isinstance(data, bool)):
        _fail(where, path, f"is {shown(data)}; it must be {_SCALARS[hint]}")
    if hint is str or hint is bool:
        return data
    rule, given = rule or Rule(), data
    if hint is float:
        data = float(data) if abs(data) <= sys.float_info.max else math.inf
    problem = rule.violation(data)
    if problem:
        unit = f" {rule.unit}" if rule.unit else ""
        told = given if data == math.inf else data
        _fail(where, path, f"is {shown(told)}{unit}; {problem}")
    return data


def _decode_union(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    options = _args(hint)
    if data is None and type(None) in options:
        return None
    options = tuple(option for option in options if option is not type(None))
    if len(options) == 1:
        return _decode(options[0], data, where, path, rule)
    tagged = {getattr(option, "KIND", None): option for option in options}
    given = data.get("kind") if isinstance(data, dict) else data
    if not isinstance(data, dict) or not isinstance(given, str) or given not in tagged:
        names = ", ".join(sorted(str(name) for name in tagged))
        _fail(where, f"{path}.kind", f"is {shown(given)}; it must be one of {names}")
    return _decode(tagged[given], data, where, path, rule)


def _decode_dataclass(cls: type, data: Any, where: str, path: str) -> Any:
    if not isinstance(data, dict):
        _fail(where, path, f"is {shown(data)}; it must be an object with named fields")
    fields = fields_to_read(cls)
    for key in () if getattr(cls, "OPEN", False) else data:
        if key not in fields:
            hint = did_you_mean(str(key), fields) or "."
            known = ", ".join(fields)
            _fail(where, _join(path, named(key)), f"is not a known field{hint} Known: {known}")
    values = {}
    for name, (hint, rule, is_needed) in fields.items():
        if name in data:
            item = data[name]
            if rule is None and type(item) is hint and _is_plain(item):
                values[name] = item
            else:
                values[name] = _decode(hint, item, where, _join(path, name), rule)
        elif is_needed:
            _fail(where, _join(path, name), "is missing")
    try:
        made = cls(**values)
        if hasattr(made, "check_stored"):
            made.check_stored()
    except InputError as error:
        error.args = (f"{where}: {path + ': ' if path else ''}{error}",)
        raise error from None
    except (AssertionError, ValueError, TypeError, ArithmeticError, LookupError) as error:
        _fail(where, path, f"holds values that do not fit each other: {error}")
    return made


@functools.cache
def fields_to_read(cls: type) -> dict[str, tuple[Any, Rule | None, bool]]:
    """Give type hint and rule of each field of a dataclass, and whether it must be there."""
    hints = typing.get_type_hints(cls)
    missing = dataclasses.MISSING
    return {
        field.name: (
            hints[field.name],
            field.metadata.get("rule"),
            field.default is missing and field.default_factory is missing,
        )
        for field in dataclasses.fields(cls)
    }


def _decode_tuple(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    if not isinstance(data, (list, tuple)):
        _fail(where, path, f"is {shown(data)}; it must be a list")
    args = _args(hint)
    if len(args) == 2 and args[1] is Ellipsis:
        if rule is None and all(type(item) in _alike(args[0]) and _is_plain(item) for item in data):
            return tuple(data)
        return tuple(
            _decode(args[0], item, where, f"{path}[{i}]", rule) for i, item in enumerate(data)
        )
    if len(data) != len(args):
        _fail(where, path, f"has {len(data)} entries; it must have {len(args)}")
    items = zip(args, data, strict=True)
    return tuple(
        _decode(arg, item, where, f"{path}[{i}]", rule) for i, (arg, item) in enumerate(items)
    )


def _decode_dict(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    if not isinstance(data, dict):
        _fail(where, path, f"is {shown(data)}; it must be an object")
    _, value_hint = _args(hint)
    plain = _alike(value_hint) if rule is None else ()
    made = {
        str(key): item
        if type(item) in plain and _is_plain(item)
        else _decode(value_hint, item, where, _join(path, named(key)), rule)
        for key, item in data.items()
    }
    if len(made) < len(data):
        _fail(where, path, "has a number and the same number as text for keys; names must differ")
    return made


def _decode_array(data: Any, where: str, path: str, rule: Rule) -> Array:
    if not _is_of_numbers(data, null=rule.allow_missing):
        _fail(where, path, f"is {shown(data)}; it must be numbers")
    try:
        array = frozen_array(data)
    except OverflowError:
        _fail(where, path, f"is {shown(data)}; it must be finite")
    except (TypeError, ValueError):
        _fail(where, path, f"is {shown(data)}; it must be numbers, lists of one length in a list")
    if rule.shape is not None:
        # An empty list carries no trailing dimensions; give it the declared ones.
        if array.size == 0 and any(isinstance(n, str) for n in rule.shape):
            empty = tuple(0 if isinstance(n, str) else n for n in rule.shape)
            array = frozen_array(np.zeros(empty))
        if not rule.fits(array.shape):
            wanted = "(" + ", ".join(map(str, rule.shape)) + ("," * (len(rule.shape) == 1)) + ")"
            _fail(where, path, f"has shape {array.shape}; it must be {wanted}")
    problem = rule.violation(array)
    if problem:
        unit = f" {rule.unit}" if rule.unit else ""
        _fail(where, path, f"is {shown(array.tolist())}{unit}; {problem}")
    return array


def _is_of_numbers(data: Any, *, null: bool) -> bool:
    """Whether data are numbers in nested lists; text, true and false are none, null may be."""
    if isinstance(data, (list, tuple)):
        level: Any = data
        kinds = set(map(type, level))
        while kinds and kinds <= {list, tuple}:
            level = list(itertools.chain.from_iterable(level))
            kinds = set(map(type, level))
        return kinds <= {float, int} or all(_is_of_numbers(item, null=null) for item in level)
    if data is None:
        return null
    if isinstance(data, np.ndarray):
        return data.dtype.kind in "fiu"
    return isinstance(data, (float, int, np.number)) and not isinstance(data, bool)


def named(name: Any) -> str:
    """Write a name that somebody gave into a message: as it is, unless it is long or odd."""
    text = str(name)
    return text if len(text) <= 60 and text.isprintable() else shown(text)


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


# --- soundness ---------------------------------------------------------------------------


def is_sound(value: T, known: T | None = None) -> bool:
    """Say whether ``decode`` is sure to take what ``encode`` makes of a dataclass.

    Where it is not sure it says no; ``decode`` then tells, and what is wrong.

    Args:
        value: a dataclass of this project.
        known: one of its class that ``decode`` takes; objects that both share are not looked at.
    """
    kind: Any = type(value)
    for name, check in _checks_of_fields(kind):
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
def _checks_of_fields(kind: Any) -> list[tuple[str, Check]]:
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
        fields = _checks_of_fields(typing.cast(Any, hint))
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


# --- files -----------------------------------------------------------------------------


def read_json(path: Path, *, doubled: Doubled = "refused") -> Any:
    """Read a JSON file; see :func:`~mrta_falsify.core.parsing.parse_json`."""
    return parse_json(read_text(path), str(path), doubled=doubled)


def read_yaml(path: Path, *, doubled: Doubled = "refused", as_text: Collection[str] = ()) -> Any:
    """Read a YAML file; see :func:`~mrta_falsify.core.parsing.parse_yaml`."""
    return parse_yaml(read_text(path), str(path), doubled=doubled, as_text=as_text)
