"""Who goes free without a robot, and what that says of the edges to it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from mrta_falsify.core import codec
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, edges_by_robot, is_unexplained
from mrta_falsify.specs.deadlock.watches import (
    CounterfactualAnswer,
    CounterfactualWatch,
    Question,
)

ROUNDS = 3  # of corrections; each may name a robot that was not named before


@dataclass(slots=True, eq=False)
class Removals:
    """Asks who goes free without a robot; each question once."""

    forecast: Forecast  #: from the moment in question
    progress: ProgressClock  #: of the run so far
    time: float  #: the moment [s]
    look_ahead: float  #: for which robots are watched [s]
    stride: int  #: ticks from one look to the next
    _answers: dict[tuple[int, ...], CounterfactualAnswer | None] = field(default_factory=dict)

    @property
    def is_outside(self) -> bool:
        """Whether the stack may remember what a robot that is gone has locked."""
        return self.forecast.is_outside

    def without(self, gone: tuple[int, ...], stuck: set[int]) -> CounterfactualAnswer | None:
        """Look what the others in ``stuck`` do without ``gone``; None: that cannot be tried."""
        if gone not in self._answers:
            asked = frozenset(stuck - set(gone))
            until = self.time + self.look_ahead
            question = Question(asked, frozenset(), self.time, self.time, until)
            watch = CounterfactualWatch(self.progress, question, stride=self.stride)
            answer = self.forecast(watch, without=gone)
            self._answers[gone] = (
                None
                if answer is None
                else codec.decode(CounterfactualAnswer, answer, where="forecast")
            )
        return self._answers[gone]

    def freed_without(self, i: int, stuck: set[int]) -> set[int] | None:
        """Find who of the others in ``stuck`` reaches its stop; None: that cannot be tried."""
        answer = self.without((i,), stuck)
        return None if answer is None else set(answer.freed)

    def freed_by(self, stuck: set[int]) -> dict[int, set[int]]:
        """Find who goes free without each of ``stuck``; all others, if that cannot be tried."""
        freed = {i: stuck - {i} for i in stuck}
        for i in sorted(stuck) if len(stuck) > 1 else ():
            answer = self.freed_without(i, stuck)
            if answer is None:
                break
            freed[i] = answer
        return freed


def corrected(edges: EdgesByRobot, stuck: set[int], removals: Removals) -> EdgesByRobot:
    """Correct the edges of stuck robots by what taking the blockers away shows.

    An edge holds if the robot sets out for its goal once its blocker is gone. Otherwise what
    holds it without the blocker takes the edge's place, unless these are robots among its edges
    already: then several may hold it together, and it is tried without all of them. Where one robot
    stands behind the other, it takes the place of the one that is gone: all are named without which
    the robot sets out, and does not without fewer. A robot that queues for a room, and is not held
    by who has it, waits for the room alone. A foreign stack may remember the locks of a robot that
    is gone; there an edge goes only where a thing with a name, or a person, is seen in the way, or
    where nothing but nearness spoke for it.

    Args:
        edges: of the wait-for graph, as geometry shows them.
        stuck: robots whose edges are asked about.
        removals: from the moment in question.
    """
    found = {i: list(own) for i, own in edges.items()}
    for _ in range(ROUNDS):
        before = {i: list(own) for i, own in found.items()}
        for i in sorted(stuck):
            found[i] = _corrected_of(i, found.get(i, []), stuck, removals)
        if found == before:
            break
    return found


def _corrected_of(
    i: int, own: list[BlockedBy], stuck: set[int], removals: Removals
) -> list[BlockedBy]:
    """Correct the edges of robot ``i``."""
    holds, fails, others = [], [], []
    for edge in own:
        if not _is_robot(edge):
            others.append(edge)
            continue
        answer = removals.without((edge.other,), stuck | {i})
        if answer is None or i in answer.nearer or i in answer.freed:
            holds.append(edge)
        else:
            fails.append((edge, edges_by_robot(answer.edges).get(i, [])))
    if holds:
        return [edge for edge in own if edge in holds or edge in others]
    if fails and not removals.is_outside:
        known = {e.other: e for _, instead in reversed(fails) for e in instead if _is_robot(e)}
        known |= {edge.other: edge for edge, _ in fails}
        several = _held_together(i, known, stuck, removals)
        if several:
            return [*others, *several]
    kept, together = list(others), []  # several may hold it together
    for edge, instead in fails:
        new = [e for e in instead if e.other != edge.other or e.cause == "human"]
        is_lock = removals.is_outside and edge.cause != "cluster"  # that the stack may remember
        queues = edge.cause == "queue"
        reasons = [e for e in new if _is_reason(e, named=is_lock or queues)]
        if is_lock and not reasons:
            kept.append(edge)
        elif reasons and all(map(_is_robot, reasons)) and _are_known(reasons, own):
            together.append(edge)
        else:
            # One who queues still queues, though not for this robot.
            alone = [BlockedBy(i, "queue", -1, edge.resource)] if queues else []
            kept += [e for e in reasons or alone or new if e not in kept]
    if len(together) > 1:
        answer = removals.without(tuple(sorted({e.other for e in together})), stuck | {i})
        if answer is not None and i not in answer.nearer and i not in answer.freed:
            instead = edges_by_robot(answer.edges).get(i, [])
            together = [e for e in instead if e not in kept]
    return [*kept, *together] or [BlockedBy(i, "stalled")]


def _held_together(
    i: int, known: dict[int, BlockedBy], stuck: set[int], removals: Removals
) -> list[BlockedBy]:
    """Find robots without all of which robot ``i`` sets out, and does not without fewer of them.

    Args:
        i: robot.
        known: edges to robots that may, by robot; what stands behind these is found.
        stuck: robots whose edges are asked about.
        removals: from the moment in question.

    Returns:
        Its edges to them; none if it stays without any robot that is seen in its way.
    """

    def sets_out(gone: Collection[int]) -> bool:
        answer = removals.without(tuple(sorted(gone)), stuck | {i})
        if answer is None:
            return False
        for edge in edges_by_robot(answer.edges).get(i, []):
            if _is_robot(edge):
                behind.setdefault(edge.other, edge)
        return i in answer.nearer or i in answer.freed

    for _ in range(ROUNDS):
        behind: dict[int, BlockedBy] = {}
        if sets_out(known):
            break
        if behind.keys() <= known.keys():
            return []
        known = {**behind, **known}
    else:
        return []
    needed = dict(known)
    for j in sorted(known):
        rest = {k: edge for k, edge in needed.items() if k != j}
        if rest and sets_out(rest):
            needed = rest
    return [needed[j] for j in sorted(needed)]


def _is_robot(edge: BlockedBy) -> bool:
    """Whether a robot is the blocker."""
    return edge.other >= 0 and edge.cause != "human"


def _is_reason(edge: BlockedBy, *, named: bool) -> bool:
    """Whether an edge says what holds a robot; by name or as a person, if ``named``."""
    if named and edge.cause != "human":
        return edge.cause in ("wall", "no-path") and bool(edge.resource)
    return not is_unexplained(edge) and edge.cause != "task"


def _are_known(reasons: Collection[BlockedBy], own: Collection[BlockedBy]) -> bool:
    """Whether all of ``reasons`` are among the edges that a robot has anyway."""
    return {(e.cause == "human", e.other, e.resource) for e in reasons} <= {
        (e.cause == "human", e.other, e.resource) for e in own
    }
