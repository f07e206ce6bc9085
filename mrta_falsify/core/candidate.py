"""Search spaces, proposals of samplers, and realised candidates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity

DimensionKind = Literal["range", "normal", "point", "choice", "integer", "opaque"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimension:
    """One coordinate of the search space."""

    name: str  #: object and property it belongs to, for example "bed_3.position.0"
    kind: DimensionKind
    low: float | None = None  #: bounds in the user's units, where they exist
    high: float | None = None
    choices: int = 0  #: number of values, for choice and integer


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """What was realised; alone rebuilds the scene."""

    number: int
    u: Array = quantity(shape=("k",), low=0.0, high=1.0)  #: after repair
    seed: int = 0  #: of everything that u does not cover
    params: dict[str, Any] = field(default_factory=dict)  #: overridden Scenic parameters
