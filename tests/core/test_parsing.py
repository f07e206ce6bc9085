"""Texts of strangers become plain data, or an error of one sentence."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from mrta_falsify.core import codec, parsing
from mrta_falsify.core.errors import DoubledKeyError, FormatError, InputNote
from mrta_falsify.core.parsing import parse_json, parse_yaml
from mrta_falsify.core.trace import read_trace
from mrta_falsify.stack.policy.policy_file import read_perceptron


def merge_bomb(levels: int) -> str:
    rows = ["m0: &m0 {a: 1, b: 2, c: 3}"]
    rows += [f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 9)}]}}" for i in range(1, levels)]
    return "\n".join(rows)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: !!bool maybe", "maybe is no bool"),
        ('a: !!int ""', "is no int"),
        ("a: !!timestamp soon", "timestamp"),
        ("a: !!set {a, b}", "set"),
        ("a: !!python/name:os.system x", "constructor"),
        ("a: 1\na: 2", "a is there twice"),
        ('a: "\\ud800"', "surrogate"),
        ("a: " + "[" * 3000, "nested too deep"),
        ("- " * 2000, "nested too deep"),
        ("&a [*a]", "aliases"),
        (merge_bomb(25), "merge keys"),
        ("{[1, 2]: 3}", "unhashable"),
        ("a: " + "9" * 5000, "is no int"),
    ],
)
def test_odd_yaml_is_refused_at_once(text, words):
    began = time.process_time()
    with pytest.raises(FormatError, match=words) as caught:
        parse_yaml(text, "f.yaml")
    assert str(caught.value).startswith("f.yaml: ")
    assert "\n" not in str(caught.value)
    assert time.process_time() - began < 5.0


def test_a_date_without_a_tag_is_text():
    assert parse_yaml("a: 2001-13-45\nb: 2001-01-01", "f") == {"a": "2001-13-45", "b": "2001-01-01"}


def test_keys_that_are_merged_in_may_be_there_already():
    text = "a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\nc: {<<: *a}"
    assert parse_yaml(text, "f")["b"] == {"x": 3, "y": 2}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1, "a": 2}', "a is there twice"),
        ('{"a": {"b": 1, "b": 2}}', "b is there twice"),
        ('"\\ud800"', "surrogate"),
        ('{"\\ud800": 1}', "surrogate"),
        ("[" * 101 + "]" * 101, "nested too deep"),
        ("[" * 100_000, "nested too deep"),
        ("9" * 5000, "too many digits"),
        ("{", "is not valid JSON"),
    ],
)
def test_odd_json_is_refused(text, words):
    with pytest.raises(FormatError, match=words):
        parse_json(text, "f.json")


def test_as_deep_as_allowed_is_read():
    parse_json("[" * parsing.MAX_DEPTH + "]" * parsing.MAX_DEPTH, "f")


@pytest.mark.parametrize("parse", [parse_json, parse_yaml])
@pytest.mark.parametrize(("doubled", "value"), [("first", 1), ("last", 2)])
def test_in_formats_of_others_one_value_counts_and_a_note_says_so(parse, doubled, value):
    text = '{"a": 1, "b": 0, "a": 2}'
    with pytest.raises(DoubledKeyError):
        parse(text, "f")
    with pytest.warns(InputNote, match=f"a is there twice.*{doubled} one counts"):
        assert parse(text, "f", doubled=doubled) == {"a": value, "b": 0}


@pytest.mark.parametrize(
    ("hint", "data"),
    [
        (float, 10**400),
        (float, 1e308),
        (int, 10**400),
        (int, True),
        (codec.Array, ["1.5", 2.0]),
        (codec.Array, [[True, False]]),
        (codec.Array, [1.0, None]),
        (codec.Array, [10**400, 1]),
        (dict[str, float], {1: 1.0, "1": 2.0}),
        (codec.Any, {"a": [10**400]}),
    ],
)
def test_numbers_are_numbers_that_can_be_computed_with(hint, data):
    with pytest.raises(codec.InputError):
        codec.decode(hint, data)


@pytest.mark.parametrize("read", [codec.read_json, codec.read_yaml, read_trace, read_perceptron])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, read):
    pipe = tmp_path / "world.json"
    os.mkfifo(pipe)
    with pytest.raises(FormatError, match="is a pipe, a socket or a device; it must be a file"):
        read(pipe)


def test_what_the_shell_hands_over_is_read():
    read_end, write_end = os.pipe()
    os.write(write_end, b"[1]")
    os.close(write_end)
    assert codec.read_json(Path(f"/dev/fd/{read_end}")) == [1]
    os.close(read_end)
