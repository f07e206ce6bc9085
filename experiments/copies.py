"""Copies of a world with small differences, those of which no robot lacks a place."""

from __future__ import annotations

from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import World
from scenic_worlds.variation import perturb_world


def perturbed_worlds(world: World, count: int) -> list[World]:
    """Make up to ``count`` copies of a world; fewer where some have no place for their robots."""
    found = []
    for seed in range(count):
        try:
            found.append(perturb_world(world, seed))
        except WorldError:
            continue
    return found
