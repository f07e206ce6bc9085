"""What a robot is doing: one frozen value of one of seven kinds.

============  ======================================  =======================
Activity      Means                                   Phase in the trace
============  ======================================  =======================
Off           has not joined yet                      OFF
Idle          has no stop; stands where it is         IDLE
Parking       idle, on the way to its parking spot    PARKING
Heading       on the way to its room, which it holds  DRIVING
Waiting       waits for its room, or drives to where  QUEUEING, or DRIVING
Serving       loads or unloads                        SERVING
Stalled       stays, with no way to its stop          DRIVING
============  ======================================  =======================

The room of ``Heading``, ``Waiting`` and ``Serving`` is the one of the robot's first stop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from mrta_falsify.core.fleet import Phase

# Bound once: up to Python 3.11 each `Phase.X` costs ten times a plain name.
_OFF, _IDLE, _DRIVING, _QUEUEING, _, _SERVING, _PARKING = Phase


@dataclass(frozen=True, slots=True)
class Off:
    """Has not joined yet."""

    phase: ClassVar[Phase] = _OFF


@dataclass(frozen=True, slots=True)
class Idle:
    """Has no stop to work on; stands where it is."""

    phase: ClassVar[Phase] = _IDLE


@dataclass(frozen=True, slots=True)
class Parking:
    """Drives to the parking spot that is reserved for it; has no stop to work on."""

    phase: ClassVar[Phase] = _PARKING


@dataclass(frozen=True, slots=True)
class Heading:
    """Drives to the room of its first stop, which it may enter."""

    phase: ClassVar[Phase] = _DRIVING


@dataclass(frozen=True, slots=True)
class Waiting:
    """Waits for the room of its first stop, or drives to where it is to wait."""

    queue: int  #: number of the room's queue
    place: int | None  #: place in the queue, 0 = head; None: it has not asked yet
    arrived: bool  #: stands where it is to wait

    @property
    def phase(self) -> Phase:
        """Phase of the trace."""
        return _QUEUEING if self.arrived else _DRIVING


@dataclass(frozen=True, slots=True)
class Serving:
    """Loads or unloads at its first stop."""

    phase: ClassVar[Phase] = _SERVING
    until: float  #: end of the service [s]


@dataclass(frozen=True, slots=True)
class Stalled:
    """Has a stop and no way to it; stays where it is until it is told otherwise."""

    phase: ClassVar[Phase] = _DRIVING


Activity = Off | Idle | Parking | Heading | Waiting | Serving | Stalled


def queue_place(activity: Activity) -> int:
    """Place in the queue of a room as the trace keeps it: 0 = head, -1: none."""
    if not isinstance(activity, Waiting) or activity.place is None:
        return -1
    return activity.place
