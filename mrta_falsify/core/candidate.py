"""Search spaces, proposals of samplers, and realised candidates."""

from __future__ import annotations

import ast
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import later, quantity
from mrta_falsify.core.seeding import candidate_seed, stream

#: ``opaque``: the coordinate seeds a generator; deterministic, but near values mean nothing
DimensionKind = Literal["range", "normal", "point", "choice", "integer", "opaque"]
DimensionValue: TypeAlias = float | int | bool | str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimension:
    """One coordinate of the search space."""

    name: str  #: object and property it belongs to, for example "bed_3.position.0"
    kind: DimensionKind
    low: float | None = None  #: bounds in the user's units, where they exist
    high: float | None = None
    choices: int = 0  #: number of values, for choice and integer
    values: tuple[str, ...] = later(())  #: these values, if they are equally likely and plain
    #: what each choice is: Python's text of a plain value, or words
    options: tuple[str, ...] = later(())

    def told(self, value: float | None) -> DimensionValue:
        """Give a value as a person reads it: of a choice the option, not its number.

        Args:
            value: as records keep it.

        Returns:
            A truth value, a number, or words such as the name of an object; None: not a number.
        """
        if value is None:
            return None
        if self.kind == "choice" and 0 <= int(value) < len(self.options):
            return _option(self.options[int(value)])
        return int(value) if self.kind in ("choice", "integer") else value


def _option(words: str) -> DimensionValue:
    """Read Python's text of a truth value, number or string; other words are told as they are."""
    try:
        told = ast.literal_eval(words)
    except (ValueError, SyntaxError):
        return words
    return told if isinstance(told, (bool, int, float, str)) else words


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """The unit cube that a program's randomness was mapped to."""

    dimensions: tuple[Dimension, ...]

    def __len__(self) -> int:
        """Number of dimensions k."""
        return len(self.dimensions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """What a sampler asks for."""

    number: int  #: position in the campaign, from 0
    u: Array  #: (k,) in [0, 1]
    uniform: bool = False  #: drawn evenly from the whole cube, whatever had been found before


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """What was realised; alone rebuilds the scene."""

    number: int
    u: Array = quantity(shape=("k",), low=0.0, high=1.0)  #: after repair
    seed: int = 0  #: of everything that u does not cover
    params: dict[str, Any] = field(default_factory=dict)  #: overridden Scenic parameters


def uniform_point(campaign_seed: int, number: int, k: int) -> Array:
    """Draw the uniform point ``(k,)`` of the unit cube that belongs to a candidate, read-only.

    Args:
        campaign_seed: >= 0.
        number: position in the campaign, from 0; each has a random stream of its own.
        k: number of dimensions.
    """
    u = stream(campaign_seed, f"sampler/random/{number}").random(k)
    u.setflags(write=False)
    return u


def candidate_of(campaign_seed: int, number: int, k: int) -> Candidate:
    """Draw candidate ``number`` of a campaign of independent uniform points.

    ``run --seed S`` is candidate 0 of the campaign with seed S.

    Args:
        campaign_seed: >= 0.
        number: position in the campaign, from 0.
        k: number of dimensions.
    """
    return Candidate(
        number=number,
        u=uniform_point(campaign_seed, number, k),
        seed=candidate_seed(campaign_seed, number),
    )
