from __future__ import annotations

from dataclasses import dataclass

import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, InputError, InputNote, UnknownNameError


class Fancy:
    """A component that a user has in a module of their own."""

    @dataclass(frozen=True, kw_only=True)
    class Options:
        speed: float = quantity(above=0.0, unit="m/s", default=1.0)
        defects: tuple[str, ...] = ()

    def __init__(self, options: Options) -> None:
        self.options = options


OURS = f"{__name__}:Fancy"


def test_an_unknown_name_answers_with_the_known_ones_and_the_nearest():
    with pytest.raises(UnknownNameError) as caught:
        registry.load("engine", "bulet", where="stack.yaml: engine")
    assert str(caught.value) == (
        "stack.yaml: engine: unknown engine 'bulet'; did you mean 'bullet'? "
        f"Known: {', '.join(registry.names('engine'))}"
    )


def test_an_allocator_that_is_gone_is_answered_for_with_a_note():
    with pytest.warns(InputNote, match="allocator 'smt' is gone, 'exact' answers"):
        assert registry.load("allocator", "smt") is registry.load("allocator", "exact")


def test_an_unknown_extension_point_is_an_error():
    with pytest.raises(UnknownNameError, match="unknown extension point 'motor'"):
        registry.names("motor")


def test_names_are_sorted():
    for point in registry.EXTENSION_POINTS:
        assert list(registry.names(point)) == sorted(registry.names(point))


def test_a_class_of_ones_own_is_named_by_module_and_class():
    component = registry.build("planner", Choice(OURS, {"speed": 2}))
    assert isinstance(component, Fancy)
    assert component.options.speed == 2.0


@pytest.mark.parametrize("name", ["no_such_module:X", f"{__name__}:Missing"])
def test_a_class_that_cannot_be_imported_is_a_config_error(name):
    with pytest.raises(ConfigError, match="cannot be loaded"):
        registry.load("planner", name)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sped": 1.0}, "stack.planner: sped is not a known field; did you mean 'speed'?"),
        ({"speed": 0}, "stack.planner: speed is 0.0 m/s; it must be > 0"),
        ({"speed": "quick"}, "stack.planner: speed is 'quick'; it must be a number"),
    ],
)
def test_a_wrong_option_is_reported_with_its_layer(options, message):
    with pytest.raises(InputError) as caught:
        registry.build("planner", Choice(OURS, options))
    assert str(caught.value).startswith(message)


def test_defects_reach_components_that_have_some():
    component = registry.build("planner", Choice(OURS), defects=("planner_failure_blocks_all",))
    assert component.options.defects == ("planner_failure_blocks_all",)


def test_every_registered_component_can_be_loaded():
    broken = []
    for point in registry.EXTENSION_POINTS:
        for name in registry.names(point):
            try:
                registry.load(point, name)
            except ConfigError as error:
                broken.append(str(error))
    assert broken == []
