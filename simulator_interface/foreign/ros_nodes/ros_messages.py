"""Message, service and action classes as rclpy has them, made from their definitions.

Fields have defaults, ``float32`` is rounded, arrays of numbers are ``array.array`` (``numpy`` where
their size is fixed), two messages are equal if their fields are. Where rclpy checks types, this
does: a float field takes no text.
"""

from __future__ import annotations

import array
import copy
import functools
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import Any

import numpy as np

from simulator_interface.foreign.interfaces import (
    FieldType,
    MessageField,
    MessageType,
    MessageTypes,
    humble_types,
)

_CODES = {
    "float32": "f", "float64": "d", "int8": "b", "uint8": "B", "byte": "B", "char": "B",
    "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q",
}  # fmt: skip
_DTYPES = {"f": np.float32, "d": np.float64}
_FLOATS = ("float32", "float64")
_PLAIN = frozenset((int, float, str, bool, bytes))
_NEW = object.__new__


class Definitions:
    """The definitions that classes are made from."""

    def __init__(self) -> None:
        self._types: dict[str, MessageType] | None = None
        self._classes: dict[str, type] = {}

    def add(self, types: MessageTypes) -> None:
        """Add definitions of the user's."""
        self._known().update(types)

    def packages(self) -> set[str]:
        """Name all packages that have definitions."""
        return {name.split("/")[0] for name in self._known()}

    def message(self, name: str) -> type:
        """Give the class of a message.

        Raises:
            KeyError: there is no definition.
        """
        made = self._classes.get(name)
        if made is None:
            made = self._classes[name] = _make_class(self._known()[name], self.message)
        return made

    def members(self, package: str, folder: str) -> dict[str, Any]:
        """Give what ``package.folder`` has: messages, or services, or actions, by name."""
        start = f"{package}/{folder}/"
        names = [name.removeprefix(start) for name in self._known() if name.startswith(start)]
        if folder == "msg":
            return {name: self.message(start + name) for name in names}
        ending, make = ("_Request", self._service) if folder == "srv" else ("_Goal", self._action)
        whole = [name.removesuffix(ending) for name in names if name.endswith(ending)]
        return {name: make(start + name) for name in whole if "_" not in name}

    def _service(self, name: str) -> type:
        parts = {part: self.message(f"{name}_{part}") for part in ("Request", "Response")}
        return _named(name, {**parts, "TYPE": name})

    def _action(self, name: str) -> type:
        parts = ("Goal", "Result", "Feedback")
        members: dict[str, Any] = {part: self.message(f"{name}_{part}") for part in parts}
        members["Impl"] = type(
            "Impl",
            (),
            {
                "SendGoalService": self._service(f"{name}_SendGoal"),
                "GetResultService": self._service(f"{name}_GetResult"),
                "FeedbackMessage": self.message(f"{name}_FeedbackMessage"),
            },
        )
        return _named(name, {**members, "TYPE": name})

    def _known(self) -> dict[str, MessageType]:
        if self._types is None:
            self._types = dict(humble_types())
        return self._types


DEFINITIONS = Definitions()  # of this process, as the classes that are made from them


def message_class(name: str) -> Any:
    """Give the class of a message by its name, ``pkg/msg/Name``."""
    return DEFINITIONS.message(name)


def interface_module(package: str, folder: str) -> ModuleType:
    """Make the module ``package.folder``, as ``geometry_msgs.msg``."""
    module = ModuleType(f"{package}.{folder}")
    vars(module).update(DEFINITIONS.members(package, folder))
    return module


def _named(name: str, members: dict[str, Any]) -> type:
    return type(name.rsplit("/", maxsplit=1)[-1], (), members)


class _Message:
    """What all messages do."""

    __slots__: tuple[str, ...] = ()
    TYPE = ""
    _FIELDS: tuple[str, ...] = ()
    _PLAIN_SLOTS: tuple[str, ...] = ()
    _MESSAGE_SLOTS: tuple[str, ...] = ()
    _OTHER_SLOTS: tuple[str, ...] = ()
    _DEFAULTS: tuple[Callable[[], Any], ...] = ()

    def __init__(self, **given: Any) -> None:
        for field, default in zip(self._FIELDS, self._DEFAULTS, strict=True):
            if field in given:
                setattr(self, field, given.pop(field))
            else:
                object.__setattr__(self, "_" + field, default())
        if given:
            raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(given)}")

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and all(
            np.array_equal(mine, its) if isinstance(mine, np.ndarray) else mine == its
            for mine, its in ((getattr(self, f), getattr(other, f)) for f in self._FIELDS)
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        fields = ", ".join(f"{field}={getattr(self, field)!r}" for field in self._FIELDS)
        return f"{self.TYPE.replace('/', '.')}({fields})"

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        return self.copied()

    def copied(self) -> Any:
        """Give a copy of it and of all in it, as one that has travelled."""
        new = _NEW(type(self))
        for slot in self._PLAIN_SLOTS:
            setattr(new, slot, getattr(self, slot))
        for slot in self._MESSAGE_SLOTS:
            setattr(new, slot, getattr(self, slot).copied())
        for slot in self._OTHER_SLOTS:
            setattr(new, slot, _copied(getattr(self, slot)))
        return new

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Name the fields and their types."""
        return dict(cls._KINDS)  # type: ignore[attr-defined]


def _copied(value: Any) -> Any:
    if isinstance(value, _Message):
        return value.copied()
    if isinstance(value, list):
        return [item if type(item) in _PLAIN else _copied(item) for item in value]
    return value[:] if isinstance(value, array.array) else copy.deepcopy(value)


def _make_class(type_: MessageType, find: Callable[[str], type]) -> type:
    fields = [field.name for field in type_.fields]
    body: dict[str, Any] = {
        "__slots__": tuple("_" + field for field in fields),
        "TYPE": type_.name,
        "_FIELDS": tuple(fields),
        **_slots_by_kind(type_),
        "_DEFAULTS": tuple(_default(field, find) for field in type_.fields),
        "_KINDS": tuple((field.name, _kind_name(field.type)) for field in type_.fields),
        **{constant.name: constant.value for constant in type_.constants},
        **{field.name: _property(field, find, type_.name) for field in type_.fields},
    }
    return type(type_.name.split("/")[-1], (_Message,), body)


def _slots_by_kind(type_: MessageType) -> dict[str, tuple[str, ...]]:
    """Sort slots by how they are copied."""
    kinds: dict[str, list[str]] = {"_PLAIN_SLOTS": [], "_MESSAGE_SLOTS": [], "_OTHER_SLOTS": []}
    for field in type_.fields:
        one = "_PLAIN_SLOTS" if field.type.is_primitive else "_MESSAGE_SLOTS"
        kinds["_OTHER_SLOTS" if field.type.container else one].append("_" + field.name)
    return {kind: tuple(slots) for kind, slots in kinds.items()}


def _kind_name(kind: FieldType) -> str:
    element = kind.element.replace("/msg/", "/")
    if kind.container == "array":
        return f"{element}[{kind.size}]"
    return f"sequence<{element}>" if kind.container else element


def _property(field: MessageField, find: Callable[[str], type], owner: str) -> property:
    slot, convert = "_" + field.name, _converter(field, find, owner)

    def read(self: Any) -> Any:
        return getattr(self, slot)

    def write(self: Any, value: Any) -> None:
        object.__setattr__(self, slot, convert(value))

    return property(read, write)


def _default(field: MessageField, find: Callable[[str], type]) -> Callable[[], Any]:
    kind = field.type
    if kind.container == "sequence":
        given = list(field.default) if isinstance(field.default, tuple) else []
        return _numbers_of(kind, given) or (lambda: list(given))
    if kind.container == "array":
        if not kind.is_primitive:
            return lambda: [find(kind.element)() for _ in range(kind.size)]
        zeros = field.default if isinstance(field.default, tuple) else (_zero(kind),) * kind.size
        return _fixed_of(kind, zeros) or (lambda: list(zeros))
    if not kind.is_primitive:
        return functools.partial(_made, find, kind.element)
    value = _zero(kind) if field.default is None else field.default
    return lambda: value


def _made(find: Callable[[str], type], name: str) -> Any:
    return find(name)()


def _zero(kind: FieldType) -> Any:
    if kind.element == "byte":
        return b"\x00"
    zeros: dict[str, Any] = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
    return zeros.get(kind.element, 0)


def _numbers_of(kind: FieldType, values: Iterable[Any]) -> Callable[[], Any] | None:
    code = _CODES.get(kind.element)
    if code is None or kind.element == "byte":
        return None
    made = array.array(code, values)
    return lambda: made[:]


def _fixed_of(kind: FieldType, values: Iterable[Any]) -> Callable[[], Any] | None:
    code = _CODES.get(kind.element)
    if code is None or kind.element == "byte":
        return None
    made = np.array(list(values), dtype=_DTYPES.get(code, np.dtype(code)))
    return made.copy


def _converter(
    field: MessageField, find: Callable[[str], type], owner: str
) -> Callable[[Any], Any]:
    kind, where = field.type, f"{owner}.{field.name}"
    if not kind.container:
        return _scalar_converter(kind, find, where)
    code = _CODES.get(kind.element) if kind.element != "byte" else None
    if code is None:
        one = _scalar_converter(kind, find, where)
        return lambda values: [one(value) for value in _sized(values, kind, where)]
    if kind.container == "array":
        dtype = _DTYPES.get(code, np.dtype(code))
        return lambda values: np.array(_sized(values, kind, where), dtype=dtype)
    return functools.partial(_as_array, code, where)


def _as_array(code: str, where: str, values: Any) -> Any:
    if isinstance(values, array.array) and values.typecode == code:
        return values
    try:
        return array.array(code, values)
    except TypeError:
        raise AssertionError(f"{where} takes numbers of type {code!r}") from None


def _sized(values: Any, kind: FieldType, where: str) -> Any:
    if isinstance(values, str) or not hasattr(values, "__len__"):
        raise AssertionError(f"{where} takes a sequence, not {type(values).__name__}")
    if kind.container == "array" and len(values) != kind.size:
        raise AssertionError(f"{where} takes {kind.size} elements, not {len(values)}")
    return values


def _scalar_converter(
    kind: FieldType, find: Callable[[str], type], where: str
) -> Callable[[Any], Any]:
    element = kind.element
    if not kind.is_primitive:
        return lambda value: _checked(value, find(element), where)
    if element in _FLOATS:
        return functools.partial(_as_float, element == "float32", where)
    types = {"string": str, "bool": bool, "byte": (bytes, int)}.get(element, int)
    return lambda value: _checked(value, types, where)


def _as_float(is_single: bool, where: str, value: Any) -> float:
    # rclpy takes floats alone; numpy's float64 is one.
    number: float = _checked(value, float, where)
    return array.array("f", [number])[0] if is_single else float(number)


def _checked(value: Any, types: Any, where: str) -> Any:
    if isinstance(value, types):
        return value
    if types is int and isinstance(value, np.integer):
        return int(value)
    if types is bool and isinstance(value, np.bool_):
        return bool(value)
    wanted = " or ".join(t.__name__ for t in (types if isinstance(types, tuple) else (types,)))
    raise AssertionError(f"The '{where}' field must be of type '{wanted}'")
