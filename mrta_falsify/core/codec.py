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
import json
import math
import re
import types
import typing
from collections.abc import Collection
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import FormatError, InputError
from mrta_falsify.core.spelling import did_you_mean

T = TypeVar("T")

NEGATIVE_ZERO = re.compile(r"-0\.0(?![0-9e])")  # in JSON
MAX_FILE_BYTES = 256 * 1024 * 1024  # a world is under 1 MB; anything this large is a mistake
MAX_YAML_VALUES = 10_000_000  # aliases make many of few; a floor has some 10,000
_SCALARS = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}


@dataclasses.dataclass(frozen=True, slots=True)
class Rule:
    """What a field allows beyond its type."""

    shape: tuple[int | str, ...] | None = None  #: array shape; letters match any length
    low: float | None = None  #: smallest value allowed
    above: float | None = None  #: values must be strictly greater
    high: float | None = None  #: largest value allowed
    unit: str = ""  #: written after the value in messages
    allow_infinite: bool = False

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
        if isinstance(value, np.ndarray):
            if not value.size:
                return ""
            least, most = float(value.min()), float(value.max())  # nan, if any number is
        else:
            least = most = float(value)
        is_finite = math.isfinite(least) and math.isfinite(most)
        if math.isnan(least) or not (is_finite or self.allow_infinite):
            return "it must be finite"
        if self.low is not None and least < self.low:
            return f"it must be >= {self.low:g}"
        if self.above is not None and least <= self.above:
            return f"it must be > {self.above:g}"
        if self.high is not None and most > self.high:
            return f"it must be <= {self.high:g}"
        return ""


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

    A field with ``text`` is an option of the command line, and ``text`` its help. One that
    ``came_later`` is written as :func:`later` says.
    """
    rule = Rule(shape, low, above, high, unit, allow_infinite)
    metadata: dict[str, Any] = {"rule": rule, "text": text} if text else {"rule": rule}
    if came_later:
        metadata["later"] = True
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
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


def decode(cls: type[T], data: Any, *, where: str = "input") -> T:
    """Build ``cls`` from JSON-shaped data.

    Args:
        cls: a dataclass of this project.
        data: what ``json.load`` or ``yaml.safe_load`` returned.
        where: file name that starts every error message.

    Returns:
        The value, arrays frozen.

    Raises:
        InputError: unknown, missing or ill-typed field, wrong shape, limit broken, NaN.
    """
    return typing.cast(T, _decode(cls, data, where, "", None))


def _fail(where: str, path: str, problem: str) -> typing.NoReturn:
    raise InputError(f"{where}: {path or 'top level'} {problem}")


def _show(data: Any) -> str:
    text = repr(data)
    return text if len(text) <= 60 else text[:57] + "..."


def _decode(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    if rule is None and type(data) is hint and _is_plain(data):
        return data  # most of what is stored, at a fifth of the time
    if hint is Any:
        return data
    if hint in _SCALARS:
        return _decode_scalar(hint, data, where, path, rule)
    if dataclasses.is_dataclass(hint):
        return _decode_dataclass(typing.cast(type, hint), data, where, path)
    match typing.get_origin(hint) or hint:
        case typing.Union | types.UnionType:
            return _decode_union(hint, data, where, path, rule)
        case typing.Literal:
            return _decode_choice(typing.get_args(hint), data, where, path)
        case builtins.tuple:
            return _decode_tuple(hint, data, where, path, rule)
        case builtins.dict:
            return _decode_dict(hint, data, where, path, rule)
        case np.ndarray:
            return _decode_array(data, where, path, rule or Rule())
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return hint(_decode_choice(tuple(item.value for item in hint), data, where, path))
    raise TypeError(f"{hint!r} is no type that can be read from a file")


def _decode_choice(allowed: tuple[Any, ...], data: Any, where: str, path: str) -> Any:
    if data not in allowed:
        names = ", ".join(map(repr, allowed))
        _fail(where, path, f"is {_show(data)}; it must be one of {names}")
    return data


def _is_plain(data: Any) -> bool:
    return math.isfinite(data) if type(data) is float else type(data) in (str, bool)


def _decode_scalar(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    if hint is float and isinstance(data, int) and not isinstance(data, bool):
        data = float(data)
    if not isinstance(data, hint) or (hint is int and isinstance(data, bool)):
        _fail(where, path, f"is {_show(data)}; it must be {_SCALARS[hint]}")
    if hint in (float, int):
        rule = rule or Rule()
        problem = rule.violation(float(data))
        if problem:
            unit = f" {rule.unit}" if rule.unit else ""
            _fail(where, path, f"is {data!r}{unit}; {problem}")
    return data


def _decode_union(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    options = typing.get_args(hint)
    if data is None and type(None) in options:
        return None
    options = tuple(option for option in options if option is not type(None))
    if len(options) == 1:
        return _decode(options[0], data, where, path, rule)
    tagged = {getattr(option, "KIND", None): option for option in options}
    if not isinstance(data, dict) or data.get("kind") not in tagged:
        names = ", ".join(sorted(str(name) for name in tagged))
        given = data.get("kind") if isinstance(data, dict) else data
        _fail(where, f"{path}.kind", f"is {_show(given)}; it must be one of {names}")
    return _decode(tagged[data["kind"]], data, where, path, rule)


def _decode_dataclass(cls: type, data: Any, where: str, path: str) -> Any:
    if not isinstance(data, dict):
        _fail(where, path, f"is {_show(data)}; it must be an object with named fields")
    fields = {f.name: f for f in dataclasses.fields(cls)}
    for key in data:
        if key not in fields:
            hint = did_you_mean(str(key), fields) or "."
            known = ", ".join(fields)
            _fail(where, _join(path, str(key)), f"is not a known field{hint} Known: {known}")
    hints = _type_hints(cls)
    values = {}
    for name, field in fields.items():
        if name in data:
            rule = field.metadata.get("rule")
            values[name] = _decode(hints[name], data[name], where, _join(path, name), rule)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            _fail(where, _join(path, name), "is missing")
    try:
        return cls(**values)
    except InputError as error:
        error.args = (f"{where}: {path + ': ' if path else ''}{error}",)
        raise error from None


@functools.cache
def _type_hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def _decode_tuple(hint: Any, data: Any, where: str, path: str, rule: Rule | None) -> Any:
    if not isinstance(data, (list, tuple)):
        _fail(where, path, f"is {_show(data)}; it must be a list")
    args = typing.get_args(hint)
    if len(args) == 2 and args[1] is Ellipsis:
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
        _fail(where, path, f"is {_show(data)}; it must be an object")
    _, value_hint = typing.get_args(hint)
    return {
        str(key): _decode(value_hint, item, where, _join(path, str(key)), rule)
        for key, item in data.items()
    }


def _decode_array(data: Any, where: str, path: str, rule: Rule) -> Array:
    try:
        array = frozen_array(data)
    except (TypeError, ValueError):
        _fail(where, path, f"is {_show(data)}; it must be numbers")
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
        _fail(where, path, f"is {_show(array.tolist())}{unit}; {problem}")
    return array


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


# --- files -----------------------------------------------------------------------------


def read_text(path: Path) -> str:
    """Read a text file that the user named; every failure is a :class:`FormatError`."""
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            limit = MAX_FILE_BYTES // 2**20
            raise FormatError(f"{path}: the file has {size / 2**20:.0f} MB; at most {limit} MB")
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise FormatError(f"{path}: cannot be read: {reason}") from None


def read_json(path: Path) -> Any:
    """Read a JSON file; NaN and infinity are refused by :func:`decode`, not here."""
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise FormatError(f"{path}: is not valid JSON: {error}") from None
    except RecursionError:
        raise FormatError(f"{path}: is not valid JSON: it is nested too deep") from None
    except ValueError:  # Python converts no number of thousands of digits
        detail = "a number in it has too many digits"
        raise FormatError(f"{path}: is not valid JSON: {detail}") from None


def read_yaml(path: Path, *, as_text: Collection[str] = ()) -> Any:
    """Read a YAML file, by the safe loader only.

    Args:
        path: the file.
        as_text: fields of other tools' files. If one of them is at the top, every scalar of the
            file stays the text that was written, for a reader that knows what it needs: a name
            ``007`` is no 7, and ``5e-2`` is a number (YAML 1.1 takes it for text).

    Raises:
        FormatError: it cannot be read, or is no YAML.
    """
    text = read_text(path)
    try:
        loader = yaml.SafeLoader(text)
        top = loader.get_single_node()
        fields = top.value if isinstance(top, yaml.MappingNode) else ()
        if any(key.value in as_text for key, _ in fields if isinstance(key, yaml.ScalarNode)):
            data = _as_text(top, loader, {})
        else:
            data = None if top is None else loader.construct_document(top)
        count = _values_in(data, {})
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        detail = " ".join(str(error).split())
        raise FormatError(f"{path}: is not valid YAML: {detail}") from None
    if count > MAX_YAML_VALUES:
        raise FormatError(
            f"{path}: its aliases (*name) unfold to {count:.1e} values; at most {MAX_YAML_VALUES}"
        )
    return data


def _as_text(node: Any, loader: yaml.SafeLoader, known: dict[int, Any]) -> Any:
    """Make lists, dicts and text of a node; what an alias names is made once."""
    if isinstance(node, yaml.ScalarNode):
        return node.value
    if id(node) in known:
        return known[id(node)]
    if isinstance(node, yaml.SequenceNode):
        rows = known[id(node)] = []
        rows += [_as_text(row, loader, known) for row in node.value]
        return rows
    loader.flatten_mapping(node)
    fields = known[id(node)] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise ValueError("a field has no name")
        fields[key.value] = _as_text(value, loader, known)
    return fields


def _values_in(data: Any, known: dict[int, int]) -> int:
    """Count the values of nested lists and dicts; one that is there twice counts twice."""
    if not isinstance(data, (list, dict)):
        return 1
    if id(data) not in known:
        known[id(data)] = MAX_YAML_VALUES + 1  # it holds itself, if this is ever read
        parts = data.values() if isinstance(data, dict) else data
        known[id(data)] = 1 + sum(_values_in(part, known) for part in parts)
    return known[id(data)]
