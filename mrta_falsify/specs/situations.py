"""Situations: what happened in a run, as names that can be counted over a campaign.

A situation is a wait (cause, place, part in the chain of waiting robots, phase of the robot) or a
decision of the stack (kind of event, place). The names hold over runs of one scenario: they have
resources and kinds of place, but no robots and no times.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from mrta_falsify.core.fleet import BlockedBy, Frame, Phase
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.place_kind import kind_of_place
from mrta_falsify.specs.near_deadlock import chain_role
from mrta_falsify.specs.waits import in_cycles, waits_of

#: events that any run has
EVERYDAY = frozenset(("waypoint", "assigned", "allocated", "picked-up", "dropped-off", "joined"))


@dataclass(slots=True)
class Situations:
    """Folds frames into the set of situations of a run; one object per episode."""

    world: World
    seen: set[str] = field(default_factory=set)
    _edges: tuple[BlockedBy, ...] = ()

    def update_events(self, frame: Frame) -> None:
        """Take in the stack's decisions of a tick."""
        for event in frame.events:
            if event.kind not in EVERYDAY:
                self.seen.add(" ".join(filter(None, ("event", event.kind, event.resource))))

    def update_waits(self, frame: Frame) -> None:
        """Take in who waits for whom; edges that stand already are passed over."""
        if frame.blocked_by is self._edges:
            return
        known, self._edges = set(self._edges), frame.blocked_by
        waits = waits_of(frame.blocked_by)
        members = in_cycles(waits)
        for edge in frame.blocked_by:
            if edge.cause != "task" and edge not in known:
                role = chain_role(waits, edge.robot, members)
                phase = Phase(int(frame.intent.phase[edge.robot])).name.lower()
                self.seen.add(f"{edge.cause} {self._place(edge, frame)} {role} {phase}")

    def _place(self, edge: BlockedBy, frame: Frame) -> str:
        return edge.resource or kind_of_place(
            self.world, frame.sensed.pose[edge.robot : edge.robot + 1, :2]
        )
