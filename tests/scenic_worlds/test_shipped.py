"""What the package ships is found by name, and misspelt names find the nearest known one."""

from __future__ import annotations

import subprocess
import sys

import pytest

from mrta_falsify.core.errors import ConfigError, FormatError, UnknownNameError
from mrta_falsify.core.spelling import did_you_mean, nearest_name
from scenic_worlds.shipped import library_names, scenario_names, scenario_path


def test_the_shipped_programs_are_listed_without_loading_scenic():
    code = (
        "import sys; from scenic_worlds.shipped import scenario_names; "
        "assert 'hot_room' in scenario_names(); assert 'scenic' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_program_is_found_by_name_or_path(tmp_path):
    own = tmp_path / "own.scenic"
    own.write_text("")
    assert scenario_path(str(own)) == own
    assert all(scenario_path(name).is_file() for name in scenario_names())
    with pytest.raises(FormatError, match="no such file"):
        scenario_path("absent.scenic")
    with pytest.raises(UnknownNameError, match="did you mean 'hot_room'"):
        scenario_path("hot_rom")


def test_the_librarys_names_are_classes_behaviours_functions_and_places():
    names = library_names()
    assert {"Robot", "IVStand", "FollowRoute", "random_route", "along_wall", "burst"} <= names
    assert not [name for name in names if name.startswith("_")]


@pytest.mark.parametrize(
    ("given", "nearest"),
    [("Robott", "Robot"), ("robot", "Robot"), ("colour", ""), ("max_sped", "max_speed")],
)
def test_the_nearest_name_is_found_or_none(given, nearest):
    assert nearest_name(given, ["Robot", "max_speed"]) == nearest
    assert did_you_mean(given, ["Robot", "max_speed"]) == (
        f"; did you mean {nearest!r}?" if nearest else ""
    )


def test_a_lifted_function_refuses_an_unknown_parameter_even_of_a_random_value():
    from scenic.core.distributions import Range

    from scenic_worlds.floors import warehouse

    with pytest.raises(ConfigError, match="no parameter 'aisle_widht'; did you mean 'aisle_width'"):
        warehouse(aisle_widht=Range(2, 3))
    with pytest.raises(ConfigError, match="no parameter 'zebra'; it takes aisles, picks"):
        warehouse(zebra=1)
