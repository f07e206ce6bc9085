"""When a changed stack is told apart from a sound one: not by one world, but by copies of it.

A world near a deadline fails under one stack and passes under the other by chance. Told apart they
are only if the changed stack fails in most of four copies with small differences, and the sound
one in at most one of the same copies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import World
from scenic_worlds.variation import jitter_world

COPIES = 4  # with small differences, see jitter_world
MOST = 3  # of them in which the changed stack must fail
FEW = 1  # of them in which the sound stack may fail
TRIED = 12  # copies made until COPIES of them have a place for each robot

Fails = Callable[[World], bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """What copies of a world say; counting ends once the answer is certain."""

    changed_failed: int
    changed_runs: int
    sound_failed: int = 0
    sound_runs: int = 0

    @property
    def apart(self) -> bool:
        """Whether the failure is the change's doing."""
        passed = self.sound_runs - self.sound_failed
        return self.changed_failed >= MOST and passed >= COPIES - FEW

    def __str__(self) -> str:
        """Write it as in ``3 of 3 copies, the sound stack 0 of 3``."""
        changed = f"{self.changed_failed} of {self.changed_runs} copies"
        return f"{changed}, the sound stack {self.sound_failed} of {self.sound_runs}"


def told_apart(world: World, *, changed: Fails, sound: Fails) -> Told:
    """Ask both stacks about copies of a world.

    Args:
        world: in which the changed stack fails.
        changed: whether the changed stack fails in a world.
        sound: whether the sound stack does; asked only if the changed one fails in enough copies.

    Returns:
        Counts; not apart for a world of which there are too few copies.
    """
    copies = list(_copies_of(world))
    if len(copies) < COPIES:
        return Told(changed_failed=0, changed_runs=0)
    failed, runs = _count(copies, changed, enough=MOST, spare=COPIES - MOST)
    if failed < MOST:
        return Told(changed_failed=failed, changed_runs=runs)
    sound_failed, sound_runs = _count(copies, sound, enough=FEW + 1, spare=COPIES - FEW - 1)
    return Told(
        changed_failed=failed, changed_runs=runs, sound_failed=sound_failed, sound_runs=sound_runs
    )


def _copies_of(world: World) -> Iterator[World]:
    """Make the first copies that have a place for each robot."""
    found = 0
    for seed in range(TRIED):
        try:
            copy = jitter_world(world, seed)
        except WorldError:
            continue
        yield copy
        found += 1
        if found == COPIES:
            return


def _count(copies: list[World], fails: Fails, *, enough: int, spare: int) -> tuple[int, int]:
    """Count failures and runs, until there are enough failures or more than ``spare`` passes."""
    failed = 0
    for runs, copy in enumerate(copies, start=1):
        failed += fails(copy)
        if failed >= enough or runs - failed > spare:
            return failed, runs
    return failed, len(copies)
