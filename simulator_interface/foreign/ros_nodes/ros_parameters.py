"""``rclpy.parameter``: parameters of a node, with types, overrides and callbacks."""

from __future__ import annotations

import array
import enum
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from simulator_interface.foreign.ros_nodes.ros_messages import message_class


class ParameterException(Exception):  # noqa: N818 - rclpy's name
    """What is wrong with a parameter."""


class ParameterNotDeclaredException(ParameterException):
    """The node has no such parameter."""


class ParameterAlreadyDeclaredException(ParameterException):
    """The node has such a parameter already."""


class ParameterUninitializedException(ParameterException):
    """The parameter was declared by its type alone and has no value."""


class InvalidParameterTypeException(ParameterException):
    """A value is of another type than the parameter."""


class InvalidParameterValueException(ParameterException):
    """A callback refused a value."""


class ParameterType(enum.IntEnum):
    """Types, numbered as in ``rcl_interfaces/msg/ParameterType``."""

    NOT_SET = 0
    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4
    BYTE_ARRAY = 5
    BOOL_ARRAY = 6
    INTEGER_ARRAY = 7
    DOUBLE_ARRAY = 8
    STRING_ARRAY = 9

    @classmethod
    def from_parameter_value(cls, value: Any) -> ParameterType:
        """Give the type of a value.

        Raises:
            TypeError: no parameter can have it.
        """
        if value is None:
            return cls.NOT_SET
        for kind, one in _SINGLE.items():
            if type(value) is one:
                return kind
        if isinstance(value, array.array):
            return cls.DOUBLE_ARRAY if value.typecode in "fd" else cls.INTEGER_ARRAY
        if isinstance(value, (list, tuple)):
            for kind, one in _ARRAYS.items():
                if all(type(item) is one for item in value):
                    return kind
        raise TypeError(f"The given value is not one of the allowed types '{value!r}'.")

    def check(self, value: Any) -> bool:
        """Tell whether a value is of this type."""
        if isinstance(value, (list, tuple)) and not value:
            return self >= Type.BYTE_ARRAY
        return Type.from_parameter_value(value) == self


Type = ParameterType  # rclpy's name, as a part of Parameter
_SINGLE = {Type.BOOL: bool, Type.INTEGER: int, Type.DOUBLE: float, Type.STRING: str}
_ARRAYS = {
    Type.BYTE_ARRAY: bytes,
    Type.BOOL_ARRAY: bool,
    Type.INTEGER_ARRAY: int,
    Type.DOUBLE_ARRAY: float,
    Type.STRING_ARRAY: str,
}
#: where the value stands in `rcl_interfaces/msg/ParameterValue`
_FIELDS = {
    Type.BOOL: "bool_value",
    Type.INTEGER: "integer_value",
    Type.DOUBLE: "double_value",
    Type.STRING: "string_value",
    Type.BYTE_ARRAY: "byte_array_value",
    Type.BOOL_ARRAY: "bool_array_value",
    Type.INTEGER_ARRAY: "integer_array_value",
    Type.DOUBLE_ARRAY: "double_array_value",
    Type.STRING_ARRAY: "string_array_value",
}


class Parameter:
    """A named value.

    Args:
        name: of it.
        type_: of its value; None: as the value says.
        value: of it.

    Raises:
        ValueError: the value is of another type.
    """

    Type = Type

    def __init__(self, name: str, type_: ParameterType | None = None, value: Any = None) -> None:
        kind = Type.from_parameter_value(value) if type_ is None else Type(type_)
        if value is not None and not kind.check(value):
            raise ValueError(f"Type '{kind}' and value '{value}' do not agree")
        self.name, self.type_, self.value = name, kind, value

    def get_parameter_value(self) -> Any:
        """Give ``rcl_interfaces/msg/ParameterValue``."""
        message = message_class("rcl_interfaces/msg/ParameterValue")(type=int(self.type_))
        if self.value is not None:
            setattr(message, _FIELDS[self.type_], self.value)
        return message

    def to_parameter_msg(self) -> Any:
        """Give ``rcl_interfaces/msg/Parameter``."""
        kind = message_class("rcl_interfaces/msg/Parameter")
        return kind(name=self.name, value=self.get_parameter_value())

    @classmethod
    def from_parameter_msg(cls, message: Any) -> Parameter:
        """Read ``rcl_interfaces/msg/Parameter``."""
        kind = Type(message.value.type)
        value = None if kind == Type.NOT_SET else getattr(message.value, _FIELDS[kind])
        return cls(message.name, kind, value)

    def __repr__(self) -> str:
        return f"Parameter(name={self.name!r}, value={self.value!r})"


class Parameters:
    """The parameters of one node.

    Args:
        overrides: values that go before those that the node declares.
        allows_undeclared: whether a parameter may be set that was not declared.
    """

    def __init__(self, overrides: Mapping[str, Any], *, allows_undeclared: bool = False) -> None:
        self.overrides = dict(overrides)
        self._allows_undeclared = allows_undeclared
        self._declared: dict[str, Parameter] = {}
        self._kinds: dict[str, ParameterType] = {}  # of those whose type may not change
        self.callbacks: list[Callable[[list[Parameter]], Any]] = []

    def declare(
        self, name: str, value: Any = None, descriptor: Any = None, *, ignores: bool = False
    ) -> Parameter:
        """Declare a parameter by a default, or by a type.

        Raises:
            ParameterAlreadyDeclaredException: there is one.
            InvalidParameterTypeException: the override is of another type.
        """
        if name in self._declared:
            raise ParameterAlreadyDeclaredException(f"Parameter(s) already declared: {name}")
        kind = value if isinstance(value, Type) else Type.from_parameter_value(value)
        default = None if isinstance(value, Type) else value
        given = default if ignores else self.overrides.get(name, default)
        if kind == Type.DOUBLE and type(given) is int and name in self.overrides:
            raise _wrong_type(name, given, kind)
        is_fixed = kind != Type.NOT_SET and not getattr(descriptor, "dynamic_typing", False)
        if is_fixed:
            if given is not None and not kind.check(given):
                raise _wrong_type(name, given, kind)
            self._kinds[name] = kind
        parameter = Parameter(name, kind if given is None else None, given)
        self._declared[name] = parameter
        refused = self._refused([parameter])
        if refused:
            del self._declared[name]
            raise InvalidParameterValueException(f"Invalid parameter value for {name}: {refused}")
        return parameter

    def get(self, name: str) -> Parameter:
        """Give a parameter.

        Raises:
            ParameterNotDeclaredException: there is none.
            ParameterUninitializedException: it has no value.
        """
        parameter = self._declared.get(name)
        if parameter is None:
            if self._allows_undeclared:
                return Parameter(name, Type.NOT_SET, None)
            raise ParameterNotDeclaredException(
                f"Invalid access to undeclared parameter(s): {name}"
            )
        if parameter.value is None and name in self._kinds:
            raise ParameterUninitializedException(f"The parameter '{name}' is not initialized")
        return parameter

    def __contains__(self, name: str) -> bool:
        return name in self._declared

    def undeclare(self, name: str) -> None:
        """Forget a parameter.

        Raises:
            ParameterNotDeclaredException: there is none.
        """
        if name not in self._declared:
            raise ParameterNotDeclaredException(
                f"Invalid access to undeclared parameter(s): {name}"
            )
        del self._declared[name]
        self._kinds.pop(name, None)

    def set(self, parameters: Sequence[Parameter]) -> str:
        """Set parameters, all or none; give why not, empty: they are set.

        Raises:
            ParameterNotDeclaredException: one was not declared.
        """
        for parameter in parameters:
            if parameter.name not in self._declared and not self._allows_undeclared:
                raise ParameterNotDeclaredException(
                    f"Invalid access to undeclared parameter(s): {parameter.name}"
                )
            kind = self._kinds.get(parameter.name)
            if kind is not None and parameter.type_ != kind:
                return f"Wrong parameter type, expected '{kind.name}' got '{parameter.type_.name}'"
        refused = self._refused(list(parameters))
        if not refused:
            self._declared.update({parameter.name: parameter for parameter in parameters})
        return refused

    def by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Give those whose name begins with ``prefix.``, without it."""
        start = f"{prefix}." if prefix else ""
        return {
            name.removeprefix(start): parameter
            for name, parameter in self._declared.items()
            if name.startswith(start)
        }

    def _refused(self, parameters: list[Parameter]) -> str:
        for callback in self.callbacks:
            result = callback(parameters)
            if not result.successful:
                return result.reason or "refused"
        return ""


def _wrong_type(name: str, value: Any, kind: ParameterType) -> InvalidParameterTypeException:
    return InvalidParameterTypeException(
        f"Trying to set parameter '{name}' to '{value}', expecting type '{kind.name}'"
    )
