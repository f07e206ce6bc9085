"""Scenes as the models of :mod:`samplers.surrogate` see them: coordinates, kin and demands."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter as Counts
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.feedback import Cube
from samplers.asking import levels_at

ABOUT = 0.15  # distance in a coordinate of what is about one value
USUAL, USUAL_GAIN = 0.26, 3.0  # mean of how alike two are, and one over its spread
GATHERED_GAIN = 5.0  # one over the spread of the share of a family that is about one value
MAX_KINDS = 4  # kinds of object of which one alone may explain a margin
DEMAND = "demand"  # kind of the coordinates that preflights add


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points as the kernel sees them."""

    linear: Array  #: (n, f) centred; levels of discrete coordinates as indicators
    blocks: tuple[Array, ...]  #: by object, (n, f_b): coordinates, indicators over root two
    pairs: Array  #: (n, p) of kin coordinates, how alike they are, and of families as a whole

    def of_kind(self, kind: Kind) -> Points:
        """Keep what is of some kind of object."""
        blocks = tuple(self.blocks[number] for number in kind.blocks)
        return Points(self.linear[:, kind.linear], blocks, self.pairs[:, kind.pairs])


class Kind(NamedTuple):
    """What of points is of one kind of object."""

    linear: IntArray  #: columns
    blocks: tuple[int, ...]
    pairs: IntArray  #: columns


class Features:
    """Points of the cube, and their demands behind them, as :class:`Points`."""

    def __init__(self, cube: Cube, *, demands: int = 0) -> None:
        cube = _with_demands(cube, demands) if demands else cube
        self._families = [
            (list(kin), [np.array(cube.labels_of(i), dtype=np.int64) for i in kin])
            for kin in cube.families()
        ]
        gains: list[float] = []
        shifts: list[float] = []
        self._smooth: list[tuple[int, int]] = []  # coordinate, its column
        self._discrete: list[tuple[int, int, int]] = []  # coordinate, levels, first column
        self._blocks: list[slice] = []
        for block in cube.blocks():
            begin = len(gains)
            for i in block:
                levels = cube.level(i)
                if levels == 0:
                    self._smooth.append((i, len(gains)))
                else:
                    self._discrete.append((i, levels, len(gains)))
                gains += [np.sqrt(2.0 * levels)] * levels or [np.sqrt(12.0)]
                shifts += [-1.0 / np.sqrt(levels)] * levels if levels else [-np.sqrt(3.0)]
            self._blocks.append(slice(begin, len(gains)))
        self._gains, self._shifts = np.array(gains), np.array(shifts)
        self.kinds = self._largest_kinds(cube)

    def _largest_kinds(self, cube: Cube) -> list[Kind]:
        """List the kinds with most coordinates, and demands; none if there is only one."""
        names = [_kind_name(cube, i) for i in range(cube.dimensions)]
        if len(set(names)) < 2:
            return []
        counts = Counts(name for name in names if name != DEMAND).most_common(MAX_KINDS)
        kinds = [name for name, _ in counts] + [DEMAND] * (DEMAND in names)
        blocks = cube.blocks()
        columns = [names[i] for block in blocks for i in block for _ in range(cube.level(i) or 1)]
        pairs = [
            names[family[0]]
            for family, _ in self._families
            for _ in range(len(family) * (len(family) - 1) // 2 + 1)
        ]
        return [
            Kind(
                np.flatnonzero(np.array(columns) == name),
                tuple(n for n, block in enumerate(blocks) if names[block[0]] == name),
                np.flatnonzero(np.array(pairs) == name),
            )
            for name in kinds
        ]

    def of(self, points: Array) -> Points:
        """Convert ``points`` ``(n, k)``."""
        columns = np.empty((len(points), len(self._gains)))
        if self._smooth:
            coordinates, places = map(list, zip(*self._smooth, strict=True))
            columns[:, places] = points[:, coordinates]
        for i, levels, first in self._discrete:
            level = levels_at(points[:, i], levels)
            columns[:, first : first + levels] = np.eye(levels)[level] / np.sqrt(2.0)
        linear = columns * self._gains + self._shifts
        blocks = tuple(columns[:, block] for block in self._blocks)
        pairs = [np.zeros((len(points), 0))]
        for family, labels in self._families:
            alike = _alike(points[:, family], labels)
            each = (alike[:, *np.triu_indices(len(family), 1)] - USUAL) * USUAL_GAIN
            pairs.append(each * np.sqrt(len(family) / each.shape[1]))
            pairs.append((alike.mean(axis=2).max(axis=1)[:, None] - 0.5) * GATHERED_GAIN)
        return Points(linear, blocks, np.column_stack(pairs))


def as_coordinates(demands: Array) -> Array:
    """Scale demands of mean 0 and deviation 1 as evenly drawn coordinates are, beyond [0, 1]."""
    return np.asarray(0.5 + demands / np.sqrt(12.0))


def _with_demands(cube: Cube, count: int) -> Cube:
    """Add a coordinate for each demand of a scene, an object each."""
    k = cube.dimensions
    groups = cube.groups or tuple(range(k))
    objects = max(groups, default=-1) + 1
    return dataclasses.replace(
        cube,
        dimensions=k + count,
        levels=(cube.levels or (0,) * k) + (0,) * count,
        groups=groups + tuple(range(objects, objects + count)),
        owners=(cube.owners or ("",) * objects) + (DEMAND,) * count,
    )


def _kind_name(cube: Cube, i: int) -> str:
    """Name the kind of the object that coordinate ``i`` belongs to: ``human3`` is a ``human``."""
    if not cube.owners:
        return ""
    return re.split(r"\d", cube.owners[cube.groups[i]], maxsplit=1)[0]


def _alike(values: Array, labels: Sequence[IntArray]) -> Array:
    """Say which of kin coordinates ``(n, m)`` are about one value, ``(n, m, m)`` in [0, 1].

    Args:
        values: of the coordinates.
        labels: numbers of the values of each of the m coordinates, if they are discrete.
    """
    if len(labels[0]):
        levels = np.array([len(of) for of in labels])
        level = levels_at(values, levels)
        label = np.column_stack([of[level[:, i]] for i, of in enumerate(labels)])
        return np.asarray(label[:, :, None] == label[:, None, :], dtype=np.float64)
    return np.exp(-(((values[:, :, None] - values[:, None, :]) / ABOUT) ** 2))
