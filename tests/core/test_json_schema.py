from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import jsonschema
import pytest
from hypothesis import given

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.json_schema import Definitions
from mrta_falsify.core.world import World
from tests.strategies import worlds


@dataclass(frozen=True, kw_only=True)
class Disc:
    """A disc."""

    KIND: ClassVar[str] = "disc"
    kind: Literal["disc"] = "disc"
    radius: float = quantity(above=0.0, high=2.0, unit="m")  #: of the rim


@dataclass(frozen=True, kw_only=True)
class Box:
    KIND: ClassVar[str] = "box"
    kind: Literal["box"] = "box"
    sides: Array = quantity(shape=(2,), low=0.0, unit="m")


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """A drawing.

    With more to say.
    """

    shapes: tuple[Disc | Box, ...]
    #: where the pen
    #: has been
    path: Array = quantity(shape=("K", 2), default=[])
    pen: tuple[str, int] = ("fine", 2)
    layers: dict[str, bool] = field(default_factory=dict)
    scale: Literal["m", "mm"] = "m"
    note: str | None = None
    more: Any = None


GOOD: dict[str, Any] = {
    "shapes": [{"kind": "disc", "radius": 1.0}, {"kind": "box", "sides": [1, 0.5]}],
    "path": [[0, 0], [1, 2.5]],
    "pen": ["broad", 3],
    "layers": {"walls": True},
    "scale": "mm",
    "note": None,
    "more": {"anything": [1]},
}
BAD: list[dict[str, Any]] = [
    {"shapes": None},
    {"shapes": [{"radius": 1.0}]},  # of no kind
    {"shapes": [{"kind": "disc"}]},
    {"shapes": [{"kind": "disc", "radius": 0.0}]},
    {"shapes": [{"kind": "disc", "radius": 2.5}]},
    {"shapes": [{"kind": "disc", "radius": "1"}]},
    {"shapes": [{"kind": "box", "sides": [1, 2, 3]}]},
    {"shapes": [{"kind": "box", "sides": [1, -2]}]},
    {"path": [[0, 0, 0]]},
    {"path": [0, 0]},
    {"pen": ["fine"]},
    {"pen": ["fine", "2"]},
    {"layers": {"walls": 1}},
    {"scale": "km"},
    {"note": 1},
    {"unknown": 1},
]


def validator(kind: type) -> jsonschema.Draft202012Validator:
    known = Definitions()
    schema = known.document(known.object_of(kind), title="test")
    jsonschema.Draft202012Validator.check_schema(schema)
    json.dumps(schema, allow_nan=False)
    return jsonschema.Draft202012Validator(schema)


def test_what_is_read_is_valid():
    codec.decode(Drawing, GOOD)
    validator(Drawing).validate(GOOD)


@pytest.mark.parametrize("wrong", BAD, ids=str)
def test_what_is_refused_is_invalid(wrong):
    with pytest.raises(InputError):
        codec.decode(Drawing, {**GOOD, **wrong})
    assert not validator(Drawing).is_valid({**GOOD, **wrong})


def test_a_field_that_is_missing_is_invalid():
    assert not validator(Drawing).is_valid({"path": []})


def test_fields_tell_meaning_unit_and_default():
    known = Definitions()
    schema = known.object_of(Drawing)
    assert schema["description"] == "A drawing."
    assert schema["properties"]["path"]["description"] == "where the pen has been"
    assert schema["properties"]["pen"]["default"] == ["fine", 2]
    assert known.object_of(Disc)["properties"]["radius"]["description"] == "of the rim [m]"


def test_a_type_that_no_file_holds_is_refused():
    with pytest.raises(TypeError, match="no type that can be read"):
        Definitions().schema_of(set[int])


def test_two_classes_of_one_name_are_told_apart():
    known = Definitions()
    other = dataclass(type("Disc", (), {"__annotations__": {"side": float}}))
    assert known.schema_of(Disc) != known.schema_of(other)
    made = known.document({}, title="test")["$defs"]
    assert [list(made[name]["properties"]) for name in made] == [["kind", "radius"], ["side"]]


@given(worlds())
def test_worlds_are_valid(world):
    validator(World).validate(json.loads(codec.canonical_json(world)))
