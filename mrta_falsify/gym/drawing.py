"""Which world an episode of an environment is played in."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.programs import open_scenario
from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Candidate, SearchSpace
from mrta_falsify.core.errors import ConfigError, WorldError
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.core.world import World
from scenic_worlds import variation
from scenic_worlds.shipped import scenario_names


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlayedWorld:
    """The world of an episode."""

    world: World
    u: Array | None = None  #: (k,) of the program's cube, after repair; None: no program


class WorldSource:
    """Draws worlds from a program, or varies a fixed world.

    Args:
        source: see :func:`mrta_falsify.gym.parallel_env`.
    """

    def __init__(self, source: World | Place) -> None:
        self._program = None
        self._fixed: World | None = None
        self._seed: int | None = None
        self._number = -1  #: of the episode, counted since the seed was given
        if not isinstance(source, World) and _is_program(source):
            self._program = open_scenario(source)
        else:
            self._fixed = find_world(source)

    @property
    def space(self) -> SearchSpace:
        """What ``options["u"]`` is a point of; without a program it has no dimension."""
        return self._program.space if self._program is not None else SearchSpace(())

    def first(self) -> World:
        """Give the world of the first episode with seed 0, for what all worlds share."""
        if self._fixed is not None:
            return self._fixed
        assert self._program is not None
        return self._program.realise(self._program.candidate(0)).world

    def draw(self, seed: int | None, options: Mapping[str, Any]) -> PlayedWorld:
        """Draw the world of the next episode.

        Args:
            seed: begins the count of episodes anew; None: it goes on.
            options: ``world``, or ``u`` ``(k,)`` in [0, 1]; others are not looked at.

        Raises:
            RejectedScene: no scene near ``u`` was accepted. The episode counts all the same.
            InputError: an option cannot be used.
        """
        self._number = 0 if seed is not None else self._number + 1
        self._seed = self._seed if seed is None else seed
        if "world" in options and "u" in options:
            raise ConfigError("reset: options has both `u` and `world`; give one of them")
        if "world" in options:
            return PlayedWorld(world=_as_playable(find_world(options["world"])))
        if self._program is not None:
            return self._sampled(options.get("u"))
        if "u" in options:
            raise ConfigError("reset: options has `u`, but a fixed world has no random choices")
        assert self._fixed is not None
        if self._seed is None:
            return PlayedWorld(world=_as_playable(self._fixed))
        number = self._number
        own = self._seed if not number else candidate_seed(self._seed, number)
        return PlayedWorld(world=_as_playable(variation.vary_world(self._fixed, own)))

    def _sampled(self, u: Any) -> PlayedWorld:
        """Realise a point of the cube as a campaign with this seed does its proposal."""
        assert self._program is not None
        seed, number = self._seed or 0, self._number
        if u is None:
            asked = self._program.candidate(seed, number)
        else:
            asked = Candidate(
                number=number,
                u=_as_point(u, len(self.space)),
                seed=candidate_seed(seed, number),
                params=self._program.params,
            )
        found = self._program.realise(asked)
        return PlayedWorld(world=_as_playable(found.world), u=found.candidate.u)


def _is_program(name: Place) -> bool:
    return Path(name).suffix == ".scenic" or str(name) in scenario_names()


def _as_point(u: Any, dimensions: int) -> Array:
    try:
        point = np.asarray(u, dtype=np.float64)
    except (TypeError, ValueError):
        point = np.full(1, np.nan)
    if point.shape != (dimensions,) or not (np.isfinite(point).all()):
        raise ConfigError(f"reset: options.u has shape {point.shape}; it must be ({dimensions},)")
    return point


def _as_playable(world: World) -> World:
    if world.scripted:
        raise WorldError(
            f"{world.name}: cannot be played here, because of {world.scripted}; "
            "use a program without behaviours"
        )
    return world
