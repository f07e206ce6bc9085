"""Rehearsals of the scenes of a campaign's program."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import Rehearsed
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.rehearsal import rehearse
from mrta_falsify.worker import open_program

if TYPE_CHECKING:
    from scenic_worlds.program import Program

ATTEMPTS = 20  # scenes tried; a campaign tries harder, but others can be looked at instead


class SceneRehearsal:
    """Looks at scenes; the program is compiled when the first one is asked for."""

    def __init__(self, settings: TrialSettings) -> None:
        self._settings = settings

    @functools.cached_property
    def _program(self) -> Program:
        return open_program(self._settings)

    def __call__(self, u: Array) -> Rehearsed | None:
        """See :class:`~mrta_falsify.core.protocols.Rehearsal`."""
        settings = self._settings
        asked = Candidate(
            number=0,
            u=np.asarray(u, dtype=np.float64),
            seed=candidate_seed(settings.seed, 0),
            params=settings.params,
        )
        try:
            found = self._program.realise(asked, mode=settings.mode, max_attempts=ATTEMPTS)
        except InputError:
            return None
        return Rehearsed(found.candidate.u, rehearse(found.world))
