"""ROS 2's message types as DDS sees them: classes of ``cyclonedds``, made from definitions.

A type is named as rosidl names it (``geometry_msgs::msg::dds_::Twist_``), final, and serialised as
plain CDR (XCDR1).
"""

from __future__ import annotations

import keyword
from collections.abc import Callable
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct, types
from cyclonedds.idl.annotations import final

from simulator_interface.foreign.interfaces import (
    EMPTY_MEMBER,
    FieldType,
    MessageField,
    MessageTypes,
    message_type,
)

_PRIMITIVES = {
    "bool": bool,
    "string": str,
    "byte": types.uint8,
    "char": types.uint8,
    **{
        name: getattr(types, name)
        for name in (
            *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
            *("float32", "float64"),
        )
    },
}
_ZEROS = {"bool": False, "string": "", "float32": 0.0, "float64": 0.0}
_EMPTY = MessageField(name=EMPTY_MEMBER, type=FieldType(element="uint8"))
MAX_BOUNDED = 65535  # elements; cyclonedds bounds no longer ones, and a bound is not on the wire

Factory = Callable[[], Any]


class WireTypes:
    """Classes and messages of a set of definitions; each class is made once, when asked for.

    Args:
        known: the definitions.
    """

    def __init__(self, known: MessageTypes) -> None:
        self._known = known
        self._classes: dict[str, type[IdlStruct]] = {}
        self._factories: dict[str, tuple[Factory, ...]] = {}

    def type_of(self, name: str) -> type[IdlStruct]:
        """Give the class of a type, ``pkg/msg/Name``.

        Raises:
            ConfigError: it is not known.
        """
        if name not in self._classes:
            message_type(self._known, name)
            self._add(name)
        return self._classes[name]

    def make(self, name: str) -> Any:
        """Make a message with the defaults of its definition."""
        made = self.type_of(name)
        return made(*[factory() for factory in self._factories[name]])

    def _add(self, name: str) -> None:
        fields = self._known[name].fields or (_EMPTY,)
        for field in fields:
            if not field.type.is_primitive:
                self.type_of(field.type.element)
        names = {f.name: f"{f.name}_" if keyword.iskeyword(f.name) else f.name for f in fields}
        package, folder, short = name.split("/")
        self._classes[name] = final(
            make_idl_struct(
                short,
                f"{package}.{folder}.dds_.{short}_",
                {names[field.name]: self._hint(field.type) for field in fields},
                field_annotations={
                    safe: {"name": name} for name, safe in names.items() if name != safe
                },
            )
        )
        self._factories[name] = tuple(self._factory(field) for field in fields)

    def _hint(self, held: FieldType) -> Any:
        element: Any = _PRIMITIVES.get(held.element) or self.type_of(held.element)
        if held.element == "string" and held.longest:
            element = types.bounded_str[held.longest]
        if held.container == "array":
            return types.array[element, held.size]
        if held.container == "sequence":
            is_bounded = 0 < held.size <= MAX_BOUNDED
            return types.sequence[element, held.size] if is_bounded else types.sequence[element]
        return element

    def _factory(self, field: MessageField) -> Factory:
        held, default = field.type, field.default
        if isinstance(default, tuple):
            return lambda: list(default)
        if default is not None:
            return lambda: default
        if held.container == "sequence":
            return list
        one: Factory = lambda: self.make(held.element)  # noqa: E731
        if held.is_primitive:
            zero = _ZEROS.get(held.element, 0)
            one = lambda: zero  # noqa: E731
        if held.container == "array":
            return lambda: [one() for _ in range(held.size)]
        return one
