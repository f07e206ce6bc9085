"""What compiled code has to know of all missions: one record a robot, for as long as it holds.

A stage that asks the same of every robot at every tick keeps such a table. It asks all robots in
one compiled call, and enters Python for those that have something to do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.stack.mission import Mission

Rows = NDArray[np.void]  #: (N,) records


def record_of(*fields: tuple[Any, ...]) -> np.dtype[np.void]:
    """Make the numpy dtype of a record with these ``fields``."""
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


class MissionTable:
    """Writes a robot's record anew when its mission has changed; only remembers to save work."""

    def __init__(
        self, record: np.dtype[np.void], describe: Callable[..., tuple[object, ...]]
    ) -> None:
        """Keep one record a robot.

        Args:
            record: its fields.
            describe: gives the values of the fields for a robot's number, its mission, and what
                :meth:`rows` is told besides.
        """
        self._describe = describe
        self._missions: list[Mission] = []
        self._rows: Rows = np.zeros(0, dtype=record)

    def rows(self, missions: list[Mission], *besides: object) -> Rows:
        """Give the records of all robots, which are the table's own.

        Args:
            missions: of all robots; compared by identity.
            besides: told to ``describe`` beside a mission that has changed.
        """
        if missions != self._missions:
            if len(missions) != len(self._missions):
                self._missions = []
                self._rows = np.zeros(len(missions), dtype=self._rows.dtype)
            for robot, (mission, known) in enumerate(
                itertools.zip_longest(missions, self._missions)
            ):
                if mission is not known:
                    self._rows[robot] = self._describe(robot, mission, *besides)
            self._missions = list(missions)
        return self._rows
