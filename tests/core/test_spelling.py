from __future__ import annotations

from dataclasses import dataclass

import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError, UnknownNameError
from mrta_falsify.core.spelling import did_you_mean, nearest_name


@pytest.mark.parametrize(
    ("name", "known", "nearest"),
    [
        ("astr", ("astar", "ompl"), "astar"),
        ("1", ("1",), ""),
        ("level_1", ("level_1", "level_2"), "level_2"),
        ("Ward", ("ward", "wards"), "ward"),
        ("x", (), ""),
        ("HospitalBed", ("Bed", "Be", "Bookshelf"), "Bed"),
    ],
)
def test_the_nearest_name_is_never_the_one_that_was_given(name, known, nearest):
    assert nearest_name(name, known) == nearest
    assert did_you_mean(name, known) == (f"; did you mean {nearest!r}?" if nearest else "")
    message = str(UnknownNameError("level", name, known))
    assert f"mean {name!r}" not in message


@dataclass(frozen=True, kw_only=True)
class Whole:
    count: int = 1


def test_an_unknown_field_is_offered_another_one():
    with pytest.raises(InputError, match="did you mean 'count'"):
        codec.decode(Whole, {"coutn": 1})
