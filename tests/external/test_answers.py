"""Commands of a stack, read field by field."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrta_falsify.core.errors import ConfigError
from simulator_interface.external.answers import Reader, Wrong, read_ready

NAMES = ("robot1", "robot2")


def read(tick: int = 3, **fields):
    message = {"type": "command", "tick": 3, "twist": bytes(48), **fields}
    return Reader(NAMES, tasks=4).read(message, tick, time=0.15)


def test_what_is_not_said_is_none_or_empty():
    answer = read()
    assert answer.twist.tolist() == [[0.0] * 3] * 2
    assert answer.goal is None
    assert answer.waits_for is None
    assert answer.events == ()
    assert answer.intent == {}


def test_arrays_come_as_bytes_or_as_lists_with_null_for_nan():
    goal = np.array([[1.0, 2.0], [np.nan, np.nan]])
    for written in (goal.tobytes(), [[1.0, 2.0], [None, None]]):
        np.testing.assert_array_equal(read(goal=written).goal, goal)


def test_events_are_of_the_tick_and_name_only_what_applies():
    (event,) = read(events=[{"kind": "picked-up", "robot": 1, "task": 2}]).events
    assert (event.time, event.kind, event.robot, event.task) == (0.15, "picked-up", 1, 2)
    assert (event.resource, event.other) == ("", -1)


def test_fields_of_the_stacks_own_are_let_through():
    assert read(x_mood="fine").twist.shape == (2, 3)


@pytest.mark.parametrize(
    ("fields", "field", "text"),
    [
        ({"type": "tick"}, "type", "is 'tick'; a tick is answered by 'command'"),
        ({"tick": 4}, "tick", "the harness sent tick 4"),
        ({"twist": bytes(40)}, "twist", "has 40 bytes; (2, 3) float64 are 48"),
        ({"twist": [[0, 0, 0]]}, "twist", "has shape (1, 3); it must be (2, 3)"),
        ({"twist": "left"}, "twist", "is 'left'; it must be numbers"),
        ({"twist": [[0, 0, 0], [0, math.inf, 0]]}, "twist", "of robot2 is (0, inf, 0)"),
        ({"goals": []}, "goals", "did you mean 'goal'?"),
        ({"stops_left": [1]}, "stops_left", "has 1 numbers, not 2"),
        ({"stops_left": [1, -1]}, "stops_left", "has -1; it must be a whole number from 0"),
        ({"stops_left": [1, True]}, "stops_left", "has True; it must be a whole number"),
        ({"paths": [[5, b""]]}, "paths", "has 5; it must be a whole number from 0 to 1"),
        ({"paths": [[0, bytes(24)]]}, "paths", "has 24 bytes; (L, 2) float64 are 16 each"),
        ({"paths": [0]}, "paths", "has 0; each entry must be a list of 2"),
        ({"events": [{"robot": 0}]}, "events", "each must be a map with a `kind`"),
        ({"events": [{"kind": "picked-up", "task": 4}]}, "events", "has 4; it must be a whole"),
        ({"events": [{"kind": "a", "who": 4}]}, "events", "has 'who'; known are kind"),
        ({"waits_for": 3}, "waits_for", "is int; it must be a list"),
        ({"took": -1.0}, "took", "is -1.0; it must be >= 0"),
        ({"signals": {"a": math.nan}}, "signals", "is nan; it must be finite"),
        ({"twist": [["0.1", "0", "0"]] * 2}, "twist", "it must be numbers"),
        ({"twist": [[True, False, False]] * 2}, "twist", "it must be numbers"),
        ({"took": 1e300}, "took", "it must be <= 600"),
        ({"events": [{"kind": "a"}] * 10_001}, "events", "has 10001 entries; at most 10000"),
    ],
)
def test_what_breaks_the_protocol_is_named_with_what_is_allowed(fields, field, text):
    with pytest.raises(Wrong) as caught:
        read(**fields)
    assert caught.value.field == field
    assert text in caught.value.text


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=64),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)
FIELDS = ("twist", "goal", "paths", "events", "stops_left", "waits_for", "took", "signals", "slack")


@given(st.dictionaries(st.sampled_from((*FIELDS, "type", "tick", "x_y", "z")), JSON, max_size=5))
def test_whatever_a_stack_says_is_read_or_refused_in_words(fields):
    with contextlib.suppress(Wrong):
        assert read(**fields).twist.shape == (2, 3)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"type": "command"}, "its type is 'command'"),
        ({"protocol": [2, 0]}, "protocol speaks version 2; this harness speaks 1"),
        ({"protocol": "1.0"}, r"protocol is '1.0'; it must be \[major, minor\]"),
        ({"encoding": "cbor"}, "encoding is 'cbor'; it must be msgpack or json"),
        ({"says": ["goal"]}, "says has 'goal'; known are deliveries, goals, paths"),
        ({"coupling": "loose"}, "coupling is 'loose'; it must be one of stepped, awaited, paced"),
        ({"coupling": []}, r"coupling is \[\]; it must be one of stepped"),
        ({"sais": ["goals"]}, "sais is no field of the message; did you mean 'says'?"),
    ],
)
def test_a_handshake_that_fails_says_why(changes, text):
    with pytest.raises(ConfigError, match=text):
        read_ready({"type": "ready", "protocol": [1, 0], **changes})


def test_a_stack_that_does_not_tell_its_coupling_is_stepped():
    assert read_ready({"type": "ready", "protocol": [1, 0]}).coupling == "stepped"


def test_a_later_minor_version_is_let_through():
    assert read_ready({"type": "ready", "protocol": [1, 7]}).minor == 7
