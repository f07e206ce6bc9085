"""Episodes whose robots can be moved by millimetres between two frames."""

from __future__ import annotations

import dataclasses

import numpy as np

from mrta_falsify.core import seeding
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.neighbours import neighbours_within
from mrta_falsify.core.world import World
from simulator_interface.engines.gaps import Obstructions
from simulator_interface.engines.kinematic import KinematicEngine, _fill_hindrance
from simulator_interface.episode import Episode

SHIFT = 0.003  # m per axis, at most: a few millimetres, less than robots can be put down to
TURN = 0.003  # rad, at most: the same at a footprint's corner
ATTEMPTS = 20  # shifts tried for a robot that stands close to something


class ShiftingKinematic(KinematicEngine):
    """The kinematic engine, with robots that can be moved by hand."""

    def nudge(self, random: np.random.Generator) -> None:
        """Move each robot by up to 3 mm and 3 mrad, never deeper into anything."""
        around = Obstructions(
            self._observer.prints, self._around.solids, self._around.people(self._human)
        )
        for i in range(len(self._pose)):
            self._pose[i] = self._shifted(i, around, random)
        self._observer.observe(self._pose, self._human)

    def _shifted(self, i: int, around: Obstructions, random: np.random.Generator) -> Array:
        body = np.empty_like(around.prints.outline[i])
        now, then = np.zeros(4), np.zeros(4)
        near = neighbours_within(self._pose, 2.0 * (float(around.prints.reach.max()) + SHIFT))
        _fill_hindrance(i, self._pose, self._pose[i], around, near, body, now)
        for _ in range(ATTEMPTS):
            there = self._pose[i] + random.uniform(-1.0, 1.0, 3) * [SHIFT, SHIFT, TURN]
            _fill_hindrance(i, self._pose, there, around, near, body, then)
            if (then >= now).all():
                return np.asarray(there)
        return self._pose[i].copy()


class _NoEdges:
    """Derives no blocked-by edges: labels do without the oracle's parts."""

    def update(self, *_: object) -> tuple[BlockedBy, ...]:
        """Find none."""
        return ()


class ShiftingEpisode(Episode):
    """An episode on the kinematic engine, with small differences on request."""

    def __init__(self, world: World, config: StackConfig) -> None:
        options = config.engine.options if config.engine.name == "kinematic" else {}
        engine = Choice("experiments.oracle.shifting:ShiftingKinematic", options)
        super().__init__(world, dataclasses.replace(config, engine=engine))
        self._tracker = _NoEdges()  # type: ignore[assignment]

    def shift(self, seed: int) -> None:
        """Move all robots by millimetres; call it between two frames.

        Args:
            seed: equal seeds give equal shifts; 0: none.
        """
        assert isinstance(self._engine, ShiftingKinematic)
        if seed:
            self._engine.nudge(seeding.stream(seed, "oracle/shift"))
