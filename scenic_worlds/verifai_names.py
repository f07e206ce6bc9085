"""VerifAI's parameters as ordinary random values, so that programs written for it run without it.

Our driver searches every random value of a program, so a parameter that asks to be searched
needs nothing special. ``scenic_worlds.model`` gives these names in place of Scenic's own, which
need VerifAI installed. ``param verifaiSamplerType`` and ``param verifaiSamplerParams`` have no
effect: the sampler is chosen by ``mrta-falsify campaign --sampler``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from scenic.core.distributions import DiscreteRange, Distribution, Options, Range

from mrta_falsify.core.errors import ConfigError


def VerifaiRange(  # noqa: N802 - VerifAI's name
    low: float, high: float, buckets: int | None = None, weights: Sequence[float] | None = None
) -> Distribution:
    """A number between ``low`` and ``high``, uniform unless weights are given.

    Args:
        low: least value.
        high: largest value.
        buckets: number of equal intervals that the range is divided into; matters only with
            weights, and must then be their number.
        weights: of the intervals; uniform within each.

    Raises:
        ConfigError: as many weights as buckets are needed.
    """
    if weights is None:
        return Range(low, high)
    weights = tuple(weights)
    if buckets is not None and buckets != len(weights):
        raise ConfigError(
            f"VerifaiRange has {len(weights)} weights for {buckets} buckets; give one for each"
        )
    width = (high - low) / len(weights)
    parts = [Range(low + i * width, low + (i + 1) * width) for i in range(len(weights))]
    return Options(dict(zip(parts, weights, strict=True)))


def VerifaiDiscreteRange(  # noqa: N802 - VerifAI's name
    low: int, high: int, weights: Sequence[float] | None = None
) -> Distribution:
    """A whole number from ``low`` to ``high``, uniform unless weights are given.

    Raises:
        ConfigError: not as many weights as numbers.
    """
    if weights is not None and len(weights) != high - low + 1:
        raise ConfigError(
            f"VerifaiDiscreteRange has {len(weights)} weights for {high - low + 1} values; "
            "give one for each"
        )
    return DiscreteRange(low, high, weights)


def VerifaiOptions(  # noqa: N802 - VerifAI's name
    options: Iterable[Any] | Mapping[Any, float],
) -> Distribution:
    """One of ``options``, equally likely, or with the weights that are a mapping's values."""
    return Options(options)


class VerifaiParameter:
    """What VerifAI calls a searched value."""

    @staticmethod
    def withPrior(  # noqa: N802 - VerifAI's name
        distribution: Distribution,
        buckets: int | None = None,
    ) -> Distribution:
        """An independent copy of a primitive distribution.

        Raises:
            ConfigError: the value is computed from others and has no copy.
        """
        if not distribution.isPrimitive:
            raise ConfigError(
                "VerifaiParameter.withPrior needs a primitive such as Range or Normal; it was "
                f"given {distribution}"
            )
        return distribution.clone()
