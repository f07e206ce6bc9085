"""Preflights of the scenes of a campaign's program."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import SceneLoads
from mrta_falsify.lab import open_program
from mrta_falsify.preflight import preflight

if TYPE_CHECKING:
    from scenic_worlds.program import Mode, Program

ATTEMPTS = 20  # scenes tried; a campaign tries harder, but others can be looked at instead


def look_at(program: Program, u: Array, *, seed: int, mode: Mode = "repair") -> SceneLoads | None:
    """Look at the scene at a point of a program's cube without running it.

    Args:
        program: whose scene it is.
        u: ``(k,)`` in [0, 1].
        seed: of the campaign; scenes are those of its candidate 0.
        mode: how scenes are accepted.

    Returns:
        What it asks of a stack; None: no scene was accepted, or none has a world.
    """
    asked = dataclasses.replace(program.candidate(seed), u=np.asarray(u, dtype=np.float64))
    try:
        found = program.realise(asked, mode=mode, max_attempts=ATTEMPTS)
    except InputError:
        return None
    return SceneLoads(found.candidate.u, preflight(found.world))


class ScenePreflight:
    """Looks at scenes of a campaign; its program is compiled when the first one is asked for."""

    def __init__(self, settings: TrialSettings) -> None:
        self._settings = settings

    @functools.cached_property
    def _program(self) -> Program:
        return open_program(self._settings)

    def __call__(self, u: Array) -> SceneLoads | None:
        """See :class:`~mrta_falsify.core.protocols.Preflight`.

        Raises:
            InputError: the program does not compile, or has changed since the campaign began.
        """
        return look_at(self._program, u, seed=self._settings.seed, mode=self._settings.mode)
