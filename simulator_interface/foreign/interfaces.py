"""Message, service and action types of ROS 2 as plain values.

ROS 2 Humble's own messages come from the package ``rosbags`` (extra ``ros``), a user's from the
texts of ``.msg``, ``.srv`` and ``.action`` files. No code is generated: whoever needs classes makes
them from these values.

A service or action becomes the messages that it is made of, named as ROS 2 names them:
``pkg/srv/X_Request``, ``pkg/srv/X_Response``; ``pkg/action/X_Goal``, ``X_Result``, ``X_Feedback``,
``X_SendGoal_Request``, ``X_SendGoal_Response``, ``X_GetResult_Request``, ``X_GetResult_Response``,
``X_FeedbackMessage``.

Reference: https://docs.ros.org/en/humble/Concepts/Basic/About-Interfaces.html
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.parsing import read_text

if TYPE_CHECKING:
    from rosbags.typesys.base import Type

#: what a field may hold beside messages, as .msg texts name it
INTEGERS = (
    "byte",
    "char",
    "int8",
    "uint8",
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int64",
    "uint64",
)
PRIMITIVES = ("bool", *INTEGERS, "float32", "float64", "string")
Scalar = bool | int | float | str
Folder = Literal["msg", "srv", "action"]
Container = Literal["", "array", "sequence"]

#: sections of a text, by the folder that it lies in
SECTIONS: dict[str, tuple[str, ...]] = {
    "msg": ("",),
    "srv": ("_Request", "_Response"),
    "action": ("_Goal", "_Result", "_Feedback"),
}
#: member that ROS 2 gives to messages without fields on the wire, and only there
EMPTY_MEMBER = "structure_needs_at_least_one_member"
#: the only defaults other than zero in Humble's own messages; ``rosbags`` does not keep them
_HUMBLE_DEFAULTS = {("geometry_msgs/msg/Quaternion", "w"): 1.0}
#: services and actions of ROS 2 and Nav2 (Humble), which ``rosbags`` does not have
_COMMON = {
    "std_srvs/srv/Empty": "---",
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message",
    "std_srvs/srv/Trigger": "---\nbool success\nstring message",
    "action_msgs/srv/CancelGoal": (
        "GoalInfo goal_info\n---\n"
        "int8 ERROR_NONE=0\nint8 ERROR_REJECTED=1\nint8 ERROR_UNKNOWN_GOAL_ID=2\n"
        "int8 ERROR_GOAL_TERMINATED=3\nint8 return_code\nGoalInfo[] goals_canceling"
    ),
    "nav2_msgs/action/NavigateToPose": (
        "geometry_msgs/PoseStamped pose\nstring behavior_tree\n---\nstd_msgs/Empty result\n---\n"
        "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
        "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\n"
        "float32 distance_remaining"
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldType:
    """What a field holds."""

    element: str  #: one of ``PRIMITIVES``, or the name of a message type, ``pkg/msg/Name``
    container: Container = ""  #: "": one element
    size: int = 0  #: of an array; most elements of a sequence, 0: any number
    longest: int = 0  #: most characters of a string, 0: any number

    @property
    def is_primitive(self) -> bool:
        """Whether its elements are no messages."""
        return self.element in PRIMITIVES


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageField:
    """Name, type and default of one field of a message."""

    name: str
    type: FieldType
    default: Scalar | tuple[Scalar, ...] | None = None  #: None: zero, false, empty


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageConstant:
    """A constant that a message type defines."""

    name: str
    primitive: str
    value: Scalar


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageType:
    """The definition of a message; fields in the order in which they are serialised."""

    name: str  #: ``pkg/msg/Name``; parts of services and actions: ``pkg/srv/Name_Request``
    fields: tuple[MessageField, ...]
    constants: tuple[MessageConstant, ...] = ()


MessageTypes = Mapping[str, MessageType]


@functools.cache
def humble_types() -> MessageTypes:
    """Give ROS 2 Humble's own messages, and some services and actions of it and of Nav2.

    Raises:
        ConfigError: the extra ``ros`` is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise _without_extra() from None
    types: dict[str, MessageType] = {}
    for name, (constants, fields) in get_typestore(Stores.ROS2_HUMBLE).fielddefs.items():
        made = (
            MessageField(
                name=field, type=_listed(held), default=_HUMBLE_DEFAULTS.get((name, field))
            )
            for field, held in fields
            if field != EMPTY_MEMBER
        )
        known = (MessageConstant(name=n, primitive=p, value=v) for n, p, v in constants)
        types[name] = MessageType(name=name, fields=tuple(made), constants=tuple(known))
    for name, text in _COMMON.items():
        types |= parse_interface(text, name)
    return MappingProxyType(types)


def parse_interface(text: str, name: str, where: str = "") -> dict[str, MessageType]:
    """Read the definition of a message, service or action.

    Args:
        text: as in a ``.msg``, ``.srv`` or ``.action`` file.
        name: ``pkg/msg/Name``, ``pkg/srv/Name`` or ``pkg/action/Name``.
        where: the file, for messages.

    Returns:
        By name the message types that it consists of.

    Raises:
        ConfigError: the text or the name is none; the extra ``ros`` is not installed.
    """
    where = where or name
    package, folder, short = _split_name(name)
    parts = [""]
    for line in text.splitlines():
        if line.strip() == "---":
            parts.append("")
        else:
            parts[-1] += line + "\n"
    sections = SECTIONS[folder]
    if len(parts) != len(sections):
        raise ConfigError(
            f"{where}: a .{folder} text has {len(sections) - 1} line(s) `---`, "
            f"this one has {len(parts) - 1}"
        )
    types = [
        replace(_parse_message(part, f"{package}/msg/{short}", where), name=name + section)
        for part, section in zip(parts, sections, strict=True)
    ]
    if folder == "action":
        types += _action_messages(name)
    return {type_.name: type_ for type_ in types}


def read_interfaces(folder: Path) -> dict[str, MessageType]:
    """Read all files ``PACKAGE/msg/NAME.msg``, ``srv/NAME.srv``, ``action/NAME.action`` in it.

    Args:
        folder: a workspace's ``src``, a package, or anything above or below.

    Raises:
        ConfigError: there are none, or one is no definition.
    """
    types: dict[str, MessageType] = {}
    for path in sorted(folder.resolve().rglob("*")):
        kind = path.suffix[1:]
        if kind not in SECTIONS or path.parent.name != kind or not path.is_file():
            continue
        name = f"{path.parent.parent.name}/{kind}/{path.stem}"
        types |= parse_interface(read_text(path), name, str(path))
    if not types:
        raise ConfigError(
            f"{folder}: holds no PACKAGE/msg/NAME.msg, PACKAGE/srv/NAME.srv or "
            "PACKAGE/action/NAME.action"
        )
    return types


def message_type(types: MessageTypes, name: str) -> MessageType:
    """Look up a type.

    Raises:
        ConfigError: it is not known, or a type in it is not.
    """
    asked_by, seen = {name: name}, set[str]()
    while asked_by:
        wanted, where = asked_by.popitem()
        if wanted not in types:
            raise ConfigError(
                f"{where}: no definition of {wanted} is known; "
                "give the folder that holds its .msg, .srv or .action file"
            )
        seen.add(wanted)
        for field in types[wanted].fields:
            if not field.type.is_primitive and field.type.element not in seen:
                asked_by[field.type.element] = f"{wanted}.{field.name}"
    return types[name]


def _without_extra() -> ConfigError:
    return ConfigError("ROS 2 messages need the extra `ros`; in the checkout: pip install '.[ros]'")


def _split_name(name: str) -> tuple[str, Folder, str]:
    parts = name.split("/")
    is_name = len(parts) == 3 and all(part.isidentifier() for part in parts)
    if not is_name or parts[1] not in SECTIONS:
        raise ConfigError(
            f"{name}: is no name of a type; it must be PACKAGE/msg/NAME, PACKAGE/srv/NAME or "
            "PACKAGE/action/NAME"
        )
    return parts[0], parts[1], parts[2]  # type: ignore[return-value]


def _parse_message(text: str, name: str, where: str) -> MessageType:
    try:
        from rosbags.typesys import TypesysError  # noqa: PLC0415 - an extra
        from rosbags.typesys.msg import MSGParser  # noqa: PLC0415 - get_types_from_msg, with defaults
    except ImportError:
        raise _without_extra() from None
    try:
        (parsed,) = MSGParser(f"MSG: {name}\n{text}").specification()
    except (TypesysError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ConfigError(f"{where}: cannot be read as a message: {reason}") from None
    fields = []
    for field in parsed.fields:
        held = _held(field.typ)
        if held.element.endswith("/wstring"):  # the parser takes it for a message
            raise ConfigError(f"{where}: {field.name} is a wstring, which is not supported")
        value = tuple(field.value) if isinstance(field.value, list) else field.value
        fields.append(MessageField(name=field.name, type=held, default=value))
    constants = (
        MessageConstant(name=c.name, primitive=c.typ.value, value=c.value) for c in parsed.constants
    )
    return MessageType(name=name, fields=tuple(fields), constants=tuple(constants))


def _listed(described: Any) -> FieldType:
    """Read a field's type as the lists of ``rosbags`` describe it: a kind, and what it is of."""
    from rosbags.interfaces import Nodetype  # noqa: PLC0415 - an extra

    kind, what = described
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element, size = what
        container: Container = "array" if kind == Nodetype.ARRAY else "sequence"
        return replace(_listed(element), container=container, size=size)
    if kind == Nodetype.NAME:
        return FieldType(element=what)
    return FieldType(element=what[0], longest=what[1])


def _held(kind: Type) -> FieldType:
    from rosbags.typesys.base import BaseType, Cardinality  # noqa: PLC0415 - an extra

    containers: dict[Cardinality, Container] = {
        Cardinality.SCALAR: "",
        Cardinality.ARRAY: "array",
        Cardinality.SEQUENCE: "sequence",
    }
    return FieldType(
        element=kind.ref.name.value if isinstance(kind.ref, BaseType) else kind.ref.name,
        container=containers[kind.cardinality],
        size=kind.size,
        longest=kind.str_size,
    )


def _action_messages(name: str) -> Iterable[MessageType]:
    """Give the messages by which an action's goals, results and feedback travel."""

    def message(ending: str, **fields: str) -> MessageType:
        held = (
            MessageField(name=field, type=FieldType(element=element))
            for field, element in fields.items()
        )
        return MessageType(name=name + ending, fields=tuple(held))

    uuid, time = "unique_identifier_msgs/msg/UUID", "builtin_interfaces/msg/Time"
    yield message("_SendGoal_Request", goal_id=uuid, goal=f"{name}_Goal")
    yield message("_SendGoal_Response", accepted="bool", stamp=time)
    yield message("_GetResult_Request", goal_id=uuid)
    yield message("_GetResult_Response", status="int8", result=f"{name}_Result")
    yield message("_FeedbackMessage", goal_id=uuid, feedback=f"{name}_Feedback")
