"""What goes onto the wire: the same bytes as an encoder that knows nothing of DDS."""

from __future__ import annotations

import random

import numpy as np
import pytest

pytest.importorskip("cyclonedds")
pytest.importorskip("rosbags")

from rosbags.typesys import Stores, get_typestore

from simulator_interface.foreign.dds.wire_types import WireTypes
from simulator_interface.foreign.interfaces import EMPTY_MEMBER, humble_types, parse_interface
from simulator_interface.foreign.robot_topics import HEARD, PUBLISHED, RobotTopics, Topics
from tests.foreign.seen_worlds import tick_seen, world_seen

STORE = get_typestore(Stores.ROS2_HUMBLE)
TABLE = sorted({kind for kind, _ in (*PUBLISHED.values(), *HEARD.values())})
NUMPY = {"bool": "bool", "byte": "uint8", "char": "uint8"}
#: rosbags takes a byte for signed, ROS does not: both agree up to 127
RANGES = {"bool": (0, 1), "byte": (0, 127), "char": (0, 127)}


@pytest.fixture(scope="module")
def types():
    return WireTypes(humble_types())


def rosbags_message(name: str, message):
    """Give the same message as ``rosbags`` has it."""
    values = {}
    fields = humble_types()[name].fields
    for field in fields:
        value, held = getattr(message, field.name), field.type
        if not held.is_primitive:
            one = held.element
            values[field.name] = (
                [rosbags_message(one, item) for item in value]
                if held.container
                else rosbags_message(one, value)
            )
        elif held.container and held.element != "string":
            values[field.name] = np.array(value, dtype=NUMPY.get(held.element, held.element))
        else:
            values[field.name] = value
    return STORE.types[name](**(values if fields else {EMPTY_MEMBER: 0}))


def filled_at_random(types: WireTypes, name: str, draw: random.Random):
    """Make a message of which every field has some value."""
    message = types.make(name)
    for field in humble_types()[name].fields:
        held = field.type
        count = {"": 1, "array": held.size, "sequence": draw.randint(0, held.size or 3)}[
            held.container
        ]
        values = [_some(types, held.element, draw) for _ in range(count)]
        setattr(message, field.name, values if held.container else values[0])
    return message


def _some(types: WireTypes, element: str, draw: random.Random):
    if "/" in element:
        return filled_at_random(types, element, draw)
    if element == "string":
        return "".join(draw.choices("abcé ", k=draw.randrange(9)))
    if element.startswith("float"):
        return float(np.dtype(element).type(draw.uniform(-1e3, 1e3)))
    if element in RANGES:
        low, high = RANGES[element]
        value = draw.randint(low, high)
        return bool(value) if element == "bool" else value
    limits = np.iinfo(element)
    return draw.randint(int(limits.min), int(limits.max))


def assert_same_bytes(name: str, message) -> None:
    ours = message.serialize(use_version_2=False)
    theirs = bytes(STORE.serialize_cdr(rosbags_message(name, message), name))
    assert ours[4:] == theirs[4:]  # behind the representation header
    assert ours[:2] == theirs[:2] == b"\x00\x01"  # CDR, little-endian
    again = type(message).deserialize(theirs)
    assert again.serialize(use_version_2=False) == ours


@pytest.mark.parametrize("name", TABLE)
def test_each_message_of_the_table_is_serialised_as_rosbags_does(types, name):
    assert_same_bytes(name, types.make(name))
    for seed in range(20):
        assert_same_bytes(name, filled_at_random(types, name, random.Random(seed)))


def test_all_of_humbles_messages_are_serialised_as_rosbags_does(types):
    for name in STORE.fielddefs:
        for seed in range(2):
            assert_same_bytes(name, filled_at_random(types, name, random.Random(seed)))


def test_what_a_tick_is_made_of_is_serialised_as_rosbags_does(types):
    topics = RobotTopics(world_seen(2), Topics(), types.make)
    people = {
        "human_position": np.array([[1.0, 2.0], [np.nan, np.nan]]),
        "human_velocity": np.array([[0.1, 0.0], [np.nan, np.nan]]),
        "human_radius": np.array([0.3, 0.3]),
    }
    task = {"task": 3, "start": 0, "end": 1}
    rows = topics.at_start() + topics.at_tick(tick_seen(5, 2, tasks=[task], **people))
    assert {topic.field for topic, _ in rows} == set(PUBLISHED)
    for topic, message in rows:
        assert_same_bytes(topic.type, message)


def test_types_are_named_as_rosidl_names_them(types):
    named = types.type_of("geometry_msgs/msg/Twist").__idl_typename__
    assert named == "geometry_msgs.msg.dds_.Twist_"  # dots stand for colons


def test_a_users_message_may_have_a_field_named_as_a_keyword(types):
    known = {
        **humble_types(),
        **parse_interface("int32 from\nfloat64[2] to [1.5, 2.5]", "a/msg/Way"),
    }
    del types
    way = WireTypes(known).make("a/msg/Way")
    way.from_ = 7
    assert way.serialize(use_version_2=False)[4:8] == (7).to_bytes(4, "little")
