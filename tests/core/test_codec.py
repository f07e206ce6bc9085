from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from mrta_falsify.core import codec, parsing
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import FormatError, InputError
from mrta_falsify.core.world import World, read_world, write_world
from tests.strategies import worlds


@dataclass(frozen=True, kw_only=True)
class Part:
    size: float = quantity(above=0.0, unit="m")
    tags: tuple[str, ...] = ()
    count: int = quantity(low=1, high=9, default=1)
    where: np.ndarray = field(default_factory=lambda: frozen_array([0.0, 0.0]))


@dataclass(frozen=True, kw_only=True)
class Whole:
    parts: tuple[Part, ...]
    note: str | None = None


@given(worlds())
def test_a_world_survives_the_way_to_json_and_back(world):
    again = codec.decode(World, json.loads(codec.canonical_json(world)), where="test")
    assert codec.canonical_json(again) == codec.canonical_json(world)
    assert again.digest() == world.digest()


@given(worlds())
def test_decoded_arrays_cannot_be_written(world):
    again = codec.decode(World, codec.encode(world), where="test")
    with pytest.raises(ValueError, match="read-only"):
        again.bounds[0] = 1.0


def test_equal_worlds_write_equal_files(hall, tmp_path):
    write_world(hall, tmp_path / "a.json")
    write_world(read_world(tmp_path / "a.json"), tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_negative_zero_has_the_digest_of_zero():
    assert codec.digest([0.0, {"a": -0.0}]) == codec.digest([-0.0, {"a": 0.0}])


def test_the_digest_is_the_same_in_another_process_with_another_hash_seed(hall, tmp_path):
    write_world(hall, tmp_path / "world.json")
    program = (
        "import sys, pathlib; from mrta_falsify.core.world import read_world; "
        "print(read_world(pathlib.Path(sys.argv[1])).digest())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "world.json")],
        env={**os.environ, "PYTHONHASHSEED": "4711"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == hall.digest()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"parts": [], "note": 3}, "f: note is 3; it must be text"),
        ({"parst": []}, "f: parst is not a known field; did you mean 'parts'? Known: parts, note"),
        ({}, "f: parts is missing"),
        ({"parts": {}}, "f: parts is {}; it must be a list"),
        ([], "f: top level is []; it must be an object with named fields"),
        ({"parts": [{"size": -1}]}, "f: parts[0].size is -1.0 m; it must be > 0"),
        ({"parts": [{"size": float("nan")}]}, "f: parts[0].size is nan m; it must be finite"),
        ({"parts": [{"size": float("inf")}]}, "f: parts[0].size is inf m; it must be finite"),
        ({"parts": [{"size": "2"}]}, "f: parts[0].size is '2'; it must be a number"),
        ({"parts": [{"size": True}]}, "f: parts[0].size is True; it must be a number"),
        ({"parts": [{"size": 1, "count": 1.5}]}, "f: parts[0].count is 1.5; it must be a whole"),
        ({"parts": [{"size": 1, "count": 10}]}, "f: parts[0].count is 10; it must be <= 9"),
        ({"parts": [{"size": 1, "where": ["x"]}]}, "f: parts[0].where is ['x']; it must be num"),
        ({"parts": [{"size": 1, "tags": [1]}]}, "f: parts[0].tags[0] is 1; it must be text"),
    ],
)
def test_a_mistake_is_reported_with_file_field_value_and_what_is_allowed(data, message):
    with pytest.raises(InputError) as caught:
        codec.decode(Whole, data, where="f")
    assert str(caught.value).startswith(message)


def test_wrong_array_shape_names_both_shapes(hall):
    data = codec.encode(hall)
    data["robots"][0]["pose"] = [1.0, 2.0]
    with pytest.raises(InputError, match=r"robots\[0\].pose has shape \(2,\); it must be \(3,\)"):
        codec.decode(World, data, where="w.json")


def test_an_event_of_unknown_kind_lists_the_kinds(hall):
    data = {**codec.encode(hall), "events": [{"kind": "fire", "name": "x"}]}
    with pytest.raises(InputError, match=r"events\[0\].kind is 'fire'; .* blockage, comms_outage"):
        codec.decode(World, data, where="w.json")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b'{"name": "x", "bou', "is not valid JSON"),
        (b"\xff\xfe\x00", "it is not UTF-8 text"),
        (b"[" * 100_000, "is not valid JSON"),
        (b"", "is not valid JSON"),
    ],
)
def test_a_damaged_file_is_a_format_error(tmp_path, content, problem):
    path = tmp_path / "world.json"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=problem) as caught:
        codec.read_json(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_huge_file_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.truncate(parsing.MAX_FILE_BYTES + 1)  # sparse: takes no room on disc
    with pytest.raises(FormatError, match="the file has 256 MB; at most 256 MB"):
        codec.read_json(path)


def test_a_missing_file_says_so(tmp_path):
    with pytest.raises(FormatError, match="cannot be read: No such file"):
        codec.read_json(tmp_path / "absent.json")


@pytest.mark.parametrize("text", ["a: [1, 2", "a: !!python/object:os.system {}", "\t- x: 1"])
def test_yaml_that_cannot_be_read_safely_is_refused(tmp_path: Path, text: str):
    path = tmp_path / "stack.yaml"
    path.write_text(text)
    with pytest.raises(FormatError, match="is not valid YAML"):
        codec.read_yaml(path)
