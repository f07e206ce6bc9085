"""What is said to be sound is taken by ``decode``, and what ``decode`` refuses is not."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from hypothesis import given

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.codec import is_sound, quantity
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.world import World
from tests.strategies import worlds


@dataclass(frozen=True, kw_only=True)
class Dog:
    KIND: ClassVar[str] = "dog"
    kind: Literal["dog"] = "dog"
    legs: int = quantity(low=0, high=4, default=4)


@dataclass(frozen=True, kw_only=True)
class Cat:
    KIND: ClassVar[str] = "cat"
    kind: Literal["cat"] = "cat"
    lives: float = quantity(above=0.0, default=9.0)


@dataclass(frozen=True, kw_only=True)
class House:
    name: str = "house"
    is_open: bool = True
    height: float = quantity(above=0.0, default=3.0)
    plain: float = 0.0
    rooms: int = quantity(low=1, default=2)
    corner: Array = quantity(shape=(2,), default=[0.0, 1.0])
    outline: Array = quantity(shape=("V", 2), low=0.0, default=[])
    owner: Literal["us", "them"] = "us"
    note: str | None = None
    floor: int | None = None
    tags: tuple[str, ...] = ()
    sizes: tuple[float, ...] = quantity(high=1.0, default=())
    pets: tuple[Dog | Cat, ...] = ()
    values: dict[str, float] = dataclasses.field(default_factory=dict)
    pair: tuple[int, str] = (1, "a")  # decode takes it; nobody is sure
    anything: Any = None


def is_taken(value: House) -> bool:
    try:
        codec.decode(House, codec.encode(value))
    except InputError:
        return False
    return True


def house(**changes: Any) -> House:
    return dataclasses.replace(SURE, **changes)


@dataclass(frozen=True, kw_only=True)
class Hut(House):
    """A house without the field that nobody is sure of."""

    pair: Any = (1, "a")


SURE = Hut()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"height": 2},
        {"corner": np.array([1.0, 2.0])},
        {"outline": frozen_array([[0.0, 1.0], [1.0, 2.0]])},
        {"outline": frozen_array(np.zeros((0, 2)))},
        {"note": "x", "floor": 0, "owner": "them", "tags": ("a", "b"), "sizes": (0.5, -1.0)},
        {"pets": (Dog(), Cat(), Dog(legs=3)), "values": {"a": 1.5, "b": 2}, "anything": [1]},
    ],
)
def test_what_is_sound_is_said_to_be(changes):
    assert is_sound(house(**changes))
    assert is_taken(house(**changes))


@pytest.mark.parametrize(
    "changes",
    [
        {"name": 3},
        {"is_open": 1},
        {"height": 0.0},
        {"height": math.nan},
        {"height": "high"},
        {"height": True},
        {"plain": math.inf},
        {"rooms": 0},
        {"rooms": 1.5},
        {"rooms": True},
        {"corner": frozen_array([1.0, 2.0, 3.0])},
        {"corner": frozen_array([])},
        {"corner": frozen_array(1.0)},
        {"outline": frozen_array([[0.0, -1.0]])},
        {"outline": frozen_array([[0.0, math.nan]])},
        {"outline": frozen_array([0.0, 1.0])},
        {"owner": "nobody"},
        {"note": 3},
        {"floor": "first"},
        {"tags": ("a", 3)},
        {"tags": "ab"},
        {"sizes": (0.5, 1.5)},
        {"pets": (Dog(legs=5),)},
        {"pets": (Cat(lives=0.0),)},
        {"pets": (SURE,)},
        {"pets": (None,)},
        {"values": {"a": math.nan}},
        {"values": [1.0]},
    ],
)
def test_what_decode_refuses_is_not_sound(changes):
    assert not is_taken(house(**changes))
    assert not is_sound(house(**changes))


@pytest.mark.parametrize("changes", [{"rooms": np.int64(3)}, {"tags": ["a"]}])
def test_where_it_is_not_sure_it_says_no(changes):
    assert is_taken(house(**changes))
    assert not is_sound(house(**changes))
    assert is_taken(House())
    assert not is_sound(House())


@given(worlds())
def test_worlds_are_sound(world: World):
    assert is_sound(world)
    assert is_sound(world, world)


def test_what_is_new_beside_something_known_is_looked_at():
    dog, known = Dog(), house(pets=(Dog(legs=5),))
    assert is_sound(house(pets=(*known.pets, dog)), known)
    assert not is_sound(house(pets=(*known.pets, Dog(legs=6))), known)
    assert not is_sound(house(rooms=0), known)
    assert not is_sound(house(note=3), known)
