"""What shipped specifications show in the evidence of a verdict, as far as readers rely on it.

Evidence is JSON of any shape. What is stored is compared with these shapes when it is read;
fields that they do not have are free.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class _Open:
    """A shape beside which further fields may stand."""

    OPEN: ClassVar[bool] = True


@dataclass(frozen=True, slots=True, kw_only=True)
class _Edge(_Open):
    robot: str
    cause: str
    blocked_by: str = ""
    resource: str = ""
    seen: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class _Object(_Open):
    name: str
    kind: str = ""
    carried_by: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place(_Open):
    x: float
    y: float
    near: str = ""
    distance: float = 0.0
    kind: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Claim(_Open):
    """Robots that stand, of ``no_deadlock``."""

    members: tuple[str, ...] = ()
    root: str = ""
    onsets: dict[str, float] = field(default_factory=dict)
    victims: tuple[str, ...] = ()
    blockers: tuple[str, ...] = ()
    cycle: tuple[_Edge, ...] = ()
    cycle_seen: tuple[_Edge, ...] = ()
    members_alone: tuple[str, ...] = ()
    chain: tuple[_Edge, ...] = ()
    objects: tuple[_Object, ...] = ()
    place: _Place | None = None
    places: dict[str, _Place] = field(default_factory=dict)
    onset: float = 0.0
    detected_at: float = 0.0
    kind: str = ""
    shut_room: str = ""
    shut_by: tuple[str, ...] = ()
    shut_since: float | None = None
    stands_for: float | None = None
    for_good: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Held(_Open):
    robots: tuple[str, ...] = ()
    robot: str = ""
    since: float = 0.0
    until: float | None = None
    place: _Place | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Contradiction(_Open):
    members: tuple[str, ...] = ()
    robot: str = ""
    claimed_at: float = 0.0
    refuted_at: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Standing(_Claim):
    others: tuple[_Claim, ...] = ()
    held_until_work: tuple[_Held, ...] = ()
    contradictions: tuple[_Contradiction, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Contact(_Open):
    place: _Place | None = None
    nearest: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class _LateTask(_Open):
    task: int
    deadline: float
    delivered: float | None = None
    robot: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Late(_Open):
    late: tuple[_LateTask, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Use(_Open):
    resource: str = ""
    capacity: int = 1
    nearest: tuple[str, ...] = ()
    place: _Place | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Refused(_Open):
    kind: str
    reason: str = ""
    room: str = ""
    task: int = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Refusals(_Open):
    claims: tuple[_Refused, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Loss(_Open):
    """A robot without progress, of the specifications of liveness."""

    robot: str = ""
    who: str = ""
    since: float | None = None
    waiting_since: float | None = None
    time: float = 0.0
    held_s: float = 0.0
    holders: dict[str, float] = field(default_factory=dict)
    held: dict[str, float] | None = None
    place: _Place | None = None

    def check_stored(self) -> None:
        """Refuse what held a robot without when and for how long."""
        if self.held is not None and (self.since is None or not self.robot):
            raise InputError("held: names no robot or no time since when")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Failure(_Open):
    kind: str = ""
    layer: str = ""
    exception: str = ""
    message: str = ""
    tick: int = 0
    frames: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Difference(_Open):
    field: str = ""
    robot: str = ""
    tick: int = 0


_CONTACTS = ("no_robot_robot_contact", "no_robot_human_contact", "no_robot_static_contact")
_LIVENESS = ("progress", "no_livelock", "no_starvation")
SHAPES: dict[str, type[_Open]] = {
    "no_deadlock": _Standing,
    "deadlines": _Late,
    "all_tasks_done": _Late,
    "exclusive_use": _Use,
    "honest_events": _Refusals,
    "stack_runs": _Failure,
    "repeatable": _Difference,
    "human_clearance": _Contact,
    **dict.fromkeys(_CONTACTS, _Contact),
    **dict.fromkeys(_LIVENESS, _Loss),
}


def check_evidence(spec: str, evidence: Mapping[str, Any]) -> None:
    """Refuse stored evidence of a shipped specification that readers could not tell.

    Args:
        spec: name of the specification.
        evidence: as it was read.

    Raises:
        InputError: a field has another shape than the specification writes.
    """
    shape = SHAPES.get(spec)
    if shape is not None and evidence:
        codec.decode(shape, evidence, where="evidence")
