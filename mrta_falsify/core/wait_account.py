"""Who waits for whom in a failing run: the one account that pages, pictures and lists tell.

It is read off the evidence of a verdict. Evidence of versions that named only the members'
edges is completed from the trace, as are verdicts that have no edges at all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from mrta_falsify.core.claims import SPEC, ClaimKind, claim_kind, leading_claim, members_by_onset
from mrta_falsify.core.spec_profile import profile_of
from mrta_falsify.core.task_history import robots_of, tasks_of
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict

#: what is waited for where no robot, person or thing is known, by cause; a solid otherwise
NOTHING_KNOWN = {"no-path": "no way", "queue": "the queue"}
STALLED = "stalled"  #: cause of a robot that does not drive although nothing is in its way
HELD = "held by"  #: text of an arrow that only runs without the blocker show
PUSHED = "pushed by"  #: text of the arrow from a thing to the person who has it


class WaitsFor(NamedTuple):
    """One robot cannot go on because of another robot, a person or a thing."""

    robot: str
    cause: str  #: as of :class:`~mrta_falsify.core.fleet.BlockedBy`
    blocked_by: str = ""  #: robot or person; empty: neither
    resource: str = ""  #: room, corridor or solid; empty: none is known
    seen: bool = True  #: when the failure was found; else only runs without the blocker show it


class PresentObject(NamedTuple):
    """A thing or a person that took part where robots stand."""

    name: str
    kind: str  #: furniture, person, blockage, wall
    carried_by: str = ""  #: person who pushes it; empty: no one does


class StandsAt(NamedTuple):
    """Where a member stood when the failure was found."""

    robot: str
    x: float  #: [m]
    y: float  #: [m]
    near: str  #: room or queue; empty: none is known
    distance: float  #: to it [m]


class Arrow(NamedTuple):
    """An arrow of the wait-for graph between two named nodes."""

    start: str
    end: str
    cause: str  #: why
    resource: str = ""  #: that is waited for, where another robot has it

    @property
    def text(self) -> str:
        """Say why, and for what."""
        return f"{self.cause} ({self.resource})" if self.resource else self.cause


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitAccount:
    """Who waits for whom when a failure was found."""

    waits: tuple[WaitsFor, ...]
    """Of the members from the root on, then of those who wait for them. A member of which the
    evidence has no edge is stalled: nothing is known to be in its way."""
    kind: ClaimKind | Literal[""] = ""  #: of what ``no_deadlock`` claims; empty: it is none of it
    members: tuple[str, ...] = ()  #: of that claim, the root first; empty: there is none
    victims: tuple[str, ...] = ()  #: robots that are held up by the members
    blockers: tuple[str, ...] = ()  #: idle robots that stand in the way
    objects: tuple[PresentObject, ...] = ()  #: things and people that took part
    onset: float | None = None  #: when the last member stopped [s]
    places: tuple[StandsAt, ...] = ()  #: of the members; empty: older evidence says not

    @property
    def root(self) -> str:
        """Member that stopped first; empty without members."""
        return self.members[0] if self.members else ""

    @property
    def is_closed(self) -> bool:
        """Whether each of several members waits for another one."""
        if len(self.members) < 2:
            return False
        waiting = {w.robot for w in self.waits if w.blocked_by in set(self.members) - {w.robot}}
        return waiting >= set(self.members)

    @property
    def robots(self) -> tuple[str, ...]:
        """Robots that take part: members, victims, and all that one of them waits for."""
        awaited = [w.blocked_by for w in self.waits if w.blocked_by and w.cause != "human"]
        waiting = [w.robot for w in self.waits]
        names = (*self.members, *self.victims, *waiting, *awaited, *self.blockers)
        return tuple(dict.fromkeys(names))

    @property
    def holding(self) -> tuple[str, ...]:
        """Members, and the robots that one of them waits for, directly or through others."""
        found = list(self.members)
        for robot in found:  # grows as it goes
            ahead = [w.blocked_by for w in self.of(robot) if w.blocked_by and w.cause != "human"]
            found += [name for name in dict.fromkeys(ahead) if name not in found]
        return tuple(found)

    def of(self, robot: str) -> tuple[WaitsFor, ...]:
        """List what one robot waits for."""
        return tuple(wait for wait in self.waits if wait.robot == robot)

    @property
    def arrows(self) -> tuple[Arrow, ...]:
        """List the arrows of the wait-for graph, things and those who push them included."""
        return tuple(dict.fromkeys([*self._waiting(), *self._pushing()]))

    def _waiting(self) -> Iterator[Arrow]:
        things = [item.name for item in self.objects if item.kind != "wall"]
        for wait in self.waits:
            if wait.cause == STALLED and not wait.blocked_by and not wait.resource:
                continue  # it waits for nothing
            resource = wait.resource if wait.blocked_by else ""  # else it is the node
            held = wait.cause == "wall" and not wait.resource
            cause = wait.cause if wait.seen else HELD
            for end in things if held and things else [awaited_node(wait)]:
                yield Arrow(wait.robot, end, cause, resource)

    def _pushing(self) -> Iterator[Arrow]:
        for item in self.objects:
            if item.carried_by:
                yield Arrow(item.name, item.carried_by, PUSHED)

    @property
    def nodes(self) -> tuple[str, ...]:
        """List the nodes of the wait-for graph: of the arrows, members, then what else took part.

        Who pushes something comes after it.
        """
        carriers = {item.name: item.carried_by for item in self.objects if item.carried_by}
        ends = [name for arrow in self.arrows for name in (arrow.start, arrow.end)]
        beside = [item.name for item in self.objects if item.kind != "wall"]
        names = dict.fromkeys(
            name for end in (*ends, *self.members, *beside) for name in (end, carriers.get(end))
        )
        return tuple(name for name in names if name)


def awaited_node(wait: WaitsFor) -> str:
    """Name the node of the wait-for graph that ``wait`` leads to."""
    return wait.blocked_by or wait.resource or NOTHING_KNOWN.get(wait.cause, "solid")


def wait_account(verdict: Verdict, trace: Trace | None = None) -> WaitAccount:
    """Tell who waits for whom at the time of a violation.

    Args:
        verdict: violated.
        trace: of the run; without it only what the evidence names is told.
    """
    if verdict.spec != SPEC:
        if profile_of(verdict.spec).role == "outcome":  # what cost the time may have gone by then
            return WaitAccount(waits=())
        concerned = set(verdict.who)
        if trace is not None:
            concerned |= set(robots_of(tasks_of(verdict), trace))
        return WaitAccount(waits=tuple(_followed(concerned, (), verdict, trace)))
    found = leading_claim(verdict.evidence)
    waiting = tuple(dict.fromkeys(row["robot"] for row in found.get("cycle", ())))
    named = verdict.who if set(verdict.who) & set(waiting) else waiting
    members = members_by_onset(found) or named or verdict.who
    victims = tuple(found.get("victims", ()))
    waits = [_wait(row) for row in found.get("cycle", ())]
    if "chain" in found:
        waits += [_wait(row) for row in found["chain"]]
    else:
        ahead = {wait.blocked_by for wait in waits if wait.cause != "human"}
        waits += _followed(ahead | set(victims), members, verdict, trace)
    unexplained = set(members) - {wait.robot for wait in waits}
    waits += [WaitsFor(name, STALLED) for name in members if name in unexplained]
    place = {name: i for i, name in enumerate(members)}
    onset = found.get("onset")
    return WaitAccount(
        waits=tuple(sorted(waits, key=lambda wait: place.get(wait.robot, len(place)))),
        kind=claim_kind(found, verdict.who),
        members=members,
        victims=victims,
        blockers=tuple(found.get("blockers", ())),
        objects=tuple(_object(row) for row in found.get("objects", ())),
        onset=float(onset) if isinstance(onset, (int, float)) else None,
        places=tuple(
            StandsAt(name, float(row["x"]), float(row["y"]), row["near"], float(row["distance"]))
            for name, row in found.get("places", {}).items()
        ),
    )


def _wait(row: Mapping[str, Any]) -> WaitsFor:
    blocked_by, resource = row.get("blocked_by", ""), row.get("resource", "")
    return WaitsFor(row["robot"], row["cause"], blocked_by, resource, row.get("seen", True))


def _object(row: Mapping[str, str]) -> PresentObject:
    return PresentObject(row["name"], row.get("kind", ""), row.get("carried_by", ""))


def _followed(
    waiting: Collection[str], known: Collection[str], verdict: Verdict, trace: Trace | None
) -> list[WaitsFor]:
    """Follow the edges of ``waiting`` at the time of the violation, and of all they wait for.

    Args:
        waiting: robots.
        known: robots whose edges are known already.
        verdict: violated.
        trace: of the run, if there is one.
    """
    if trace is None or not is_kept(trace):
        return []
    now = tuple(_waits_at(trace, tick_of(verdict, trace)))
    found: list[WaitsFor] = []
    done, border = set(known), set(waiting) - set(known)
    while border:
        more = [wait for wait in now if wait.robot in border]
        done |= border
        border = {wait.blocked_by for wait in more if wait.cause != "human"} - done
        found += more
    return found


def is_kept(trace: Trace) -> bool:
    """Whether a trace has its frames; of some runs only the digest is kept."""
    return "time" in trace.columns and len(trace) > 0


def tick_of(verdict: Verdict, trace: Trace) -> int:
    """Find the tick of a violation; the last one if it has no certain time."""
    last = len(trace) - 1 if is_kept(trace) else 0
    return last if verdict.violated_at is None else min(round(verdict.violated_at / trace.dt), last)


def _waits_at(trace: Trace, tick: int) -> Iterable[WaitsFor]:
    for edge in trace.edges_at(tick):
        if edge.cause != "task":
            others = trace.humans if edge.cause == "human" else trace.robots
            other = others[edge.other] if edge.other >= 0 else ""
            yield WaitsFor(trace.robots[edge.robot], edge.cause, other, edge.resource)
