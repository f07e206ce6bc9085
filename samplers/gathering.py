"""Like things happen at once: what robots contend for is seldom drawn by chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.feedback import Cube
from samplers.asking import at_label, evenly_in_logarithm, reflect

FAMILIES = (0.1, 0.9)  # of which some gather, in one proposal
SHARES = (0.4, 1.6)  # of a family that gathers, all of it from 1 on
ONE_PLACE = 0.7  # chance that a family gathers in one place, not in two
WIDTHS = (0.01, 0.3)  # of the part of a range in which a family gathers


class Gathering:
    """Gathers kin coordinates of a point about common values.

    Robots get into each other's way where several want one place at one time. Uniform draws of
    dozens of coordinates hardly ever agree. Here some families of kin coordinates (all arrivals,
    all destinations, all starts) are gathered: a random part of each lies around one value, or
    around two. The same objects gather in all families. Swarm testing draws its configurations in
    the same way (Groce et al. 2012).
    """

    def __init__(self, cube: Cube) -> None:
        self._cube = cube
        self._families = cube.families()

    def gathered(self, u: Array, random: np.random.Generator) -> Array:
        """Gather some families of ``u`` ``(k,)``, few or most of them."""
        u = np.array(u)
        chance = float(random.uniform(*FAMILIES))
        place = random.random(max(map(len, self._families), default=0))
        for family in self._families:
            if random.random() < chance:
                self._fill_gathered(u, family, place, random)
        return u

    def one_gathered(self, u: Array, random: np.random.Generator) -> Array:
        """Gather one family of ``u`` ``(k,)`` and leave the rest; no family: the same point."""
        u = np.array(u)
        if self._families:
            family = self._families[int(random.integers(len(self._families)))]
            self._fill_gathered(u, family, random.random(len(family)), random)
        return u

    def _fill_gathered(
        self, u: Array, family: Sequence[int], place: Array, random: np.random.Generator
    ) -> None:
        """Gather those of a family whose ``place`` is below a share that is drawn."""
        share = float(random.uniform(*SHARES))
        members = [i for number, i in enumerate(family) if place[number] < share]
        if self._cube.level(family[0]):
            self._fill_values(u, family, members, random)
        else:
            _fill_about(u, members, random)

    def _fill_values(
        self, u: Array, family: Sequence[int], members: Sequence[int], random: np.random.Generator
    ) -> None:
        """Give ``members`` one or two values that one of the family can have."""
        labels = self._cube.labels_of(int(random.choice(family)))
        chosen = random.choice(labels, size=_places(random))
        for i in members:
            label = int(random.choice(chosen))
            u[i] = at_label(label, self._cube.labels_of(i), float(u[i]))


def _fill_about(u: Array, members: Sequence[int], random: np.random.Generator) -> None:
    """Put ``members`` about one or two points of [0, 1]."""
    width = evenly_in_logarithm(random, *WIDTHS)
    centres = random.random(_places(random))
    for i in members:
        off = width * float(random.uniform(-0.5, 0.5))
        u[i] = reflect(float(random.choice(centres)) + off)


def _places(random: np.random.Generator) -> int:
    """Choose in how many places a family gathers."""
    return 1 if random.random() < ONE_PLACE else 2
