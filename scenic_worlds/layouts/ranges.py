"""What the parameters of layout generators may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrta_falsify.core.errors import ConfigError

Ranges = Mapping[str, tuple[float, float]]  #: lowest and highest value by parameter
Numbers = float | Sequence[float]


def check_range(layout: str, name: str, value: float, ranges: Ranges) -> None:
    """Refuse a value outside its range.

    Args:
        layout: name of the generator.
        name: of the parameter.
        value: given; a parameter whose limits are whole numbers takes only such.
        ranges: of the generator.

    Raises:
        ConfigError: names the layout, the parameter, the value and the range.
    """
    low, high = ranges[name]
    if not low <= value <= high:
        raise ConfigError(f"{layout}: {name} is {value:g}; it must be between {low:g} and {high:g}")
    if isinstance(low, int) and isinstance(high, int) and value != int(value):
        raise ConfigError(
            f"{layout}: {name} is {value:g}; it must be a whole number, {low} to {high}"
        )


def check_ranges(layout: str, values: Mapping[str, float], ranges: Ranges) -> None:
    """Refuse the first of some values, by parameter, that is outside its range.

    Raises:
        ConfigError: as of :func:`check_range`.
    """
    for name, value in values.items():
        check_range(layout, name, value, ranges)


def per_place(layout: str, name: str, given: Numbers, count: int, ranges: Ranges) -> list[float]:
    """Spread a number, or a sequence that is repeated, over the places.

    Raises:
        ConfigError: an empty sequence, or a value outside its range.
    """
    values = [float(v) for v in given] if isinstance(given, Sequence) else [float(given)]
    if not values:
        raise ConfigError(f"{layout}: {name} is empty; give a number or one per place")
    for value in values:
        check_range(layout, name, value, ranges)
    return [values[i % len(values)] for i in range(count)]


def active_flags(layout: str, active: Sequence[bool], count: int) -> list[bool]:
    """Give every place a flag; all are active if none are given.

    Raises:
        ConfigError: another number of flags.
    """
    if len(active) not in (0, count):
        raise ConfigError(
            f"{layout}: active has {len(active)} flags; it must have one per place, {count}"
        )
    return [bool(flag) for flag in active] if len(active) else [True] * count
