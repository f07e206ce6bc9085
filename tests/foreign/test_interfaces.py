"""Definitions of messages, services and actions."""

from __future__ import annotations

import pytest

from mrta_falsify.core.errors import ConfigError

pytest.importorskip("rosbags")

from simulator_interface.foreign.interfaces import (
    FieldType,
    MessageField,
    humble_types,
    message_type,
    parse_interface,
    read_interfaces,
)


def test_all_of_humbles_definitions_are_complete():
    known = humble_types()
    assert {message_type(known, name).name for name in known} == set(known)


def test_fields_come_in_the_order_in_which_they_are_serialised():
    names = [field.name for field in humble_types()["nav_msgs/msg/Odometry"].fields]
    assert names == ["header", "child_frame_id", "pose", "twist"]


def test_a_turn_by_default_is_no_turn():
    defaults = [field.default for field in humble_types()["geometry_msgs/msg/Quaternion"].fields]
    assert defaults == [None, None, None, 1.0]


def test_a_message_has_fields_constants_and_defaults():
    text = """
        int8 OPEN=1   # a constant
        string<=10[<=4] names
        float64[3] size [1.0, 2.0, 3.0]
        Door other
        geometry_msgs/Pose[] poses
        int8 state -1
    """
    (door,) = parse_interface(text, "ward/msg/Room").values()
    assert [(c.name, c.value) for c in door.constants] == [("OPEN", 1)]
    assert door.fields == (
        MessageField(
            name="names", type=FieldType(element="string", container="sequence", size=4, longest=10)
        ),
        MessageField(
            name="size",
            type=FieldType(element="float64", container="array", size=3),
            default=(1.0, 2.0, 3.0),
        ),
        MessageField(name="other", type=FieldType(element="ward/msg/Door")),
        MessageField(
            name="poses", type=FieldType(element="geometry_msgs/msg/Pose", container="sequence")
        ),
        MessageField(name="state", type=FieldType(element="int8"), default=-1),
    )


def test_a_service_is_two_messages_and_may_be_empty():
    types = parse_interface("---\nbool ok\n", "ward/srv/Call")
    assert {name: len(made.fields) for name, made in types.items()} == {
        "ward/srv/Call_Request": 0,
        "ward/srv/Call_Response": 1,
    }


def test_an_action_is_the_messages_by_which_it_travels():
    types = {**humble_types(), **parse_interface("Bed bed\n---\n---\nfloat32 left", "a/action/Go")}
    types |= parse_interface("int32 number", "a/msg/Bed")
    asked = message_type(types, "a/action/Go_SendGoal_Request")
    assert [field.type.element for field in asked.fields] == [
        "unique_identifier_msgs/msg/UUID",
        "a/action/Go_Goal",
    ]
    assert types["a/action/Go_Goal"].fields[0].type.element == "a/msg/Bed"
    assert len([name for name in types if name.startswith("a/action/Go_")]) == 8


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("int32 a", "ward/Room", "is no name of a type"),
        ("int32 a", "ward/srv/Call", "has 1 line.s. `---`, this one has 0"),
        ("int32", "ward/msg/Room", "ward/msg/Room: cannot be read as a message"),
        ("wstring a", "ward/msg/Room", "a is a wstring, which is not supported"),
    ],
)
def test_what_is_no_definition_is_refused_with_what_is_wrong(text, name, said):
    with pytest.raises(ConfigError, match=said):
        parse_interface(text, name)


def test_an_unknown_type_is_named_with_the_field_that_holds_it():
    types = parse_interface("Door door", "ward/msg/Room")
    with pytest.raises(ConfigError, match=r"ward/msg/Room\.door: no definition of ward/msg/Door"):
        message_type(types, "ward/msg/Room")


def test_a_workspace_is_read(tmp_path):
    for name, text in {"msg/Door.msg": "bool open", "srv/Call.srv": "Door door\n---"}.items():
        path = tmp_path / "src" / "ward" / name
        path.parent.mkdir(parents=True)
        path.write_text(text)
    types = read_interfaces(tmp_path)
    assert list(types) == ["ward/msg/Door", "ward/srv/Call_Request", "ward/srv/Call_Response"]
    assert message_type(types, "ward/srv/Call_Request").fields[0].type.element == "ward/msg/Door"


def test_a_folder_without_definitions_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="holds no PACKAGE/msg/NAME"):
        read_interfaces(tmp_path)
