"""The deadlock oracle: robots that never reach their next stop, because of each other.

A robot is *stuck* if it never reaches its next stop, neither if nothing more comes from outside
nor if all comes that is still to come. The run itself tells (see
:class:`~mrta_falsify.core.protocols.Forecast`): copies of it continue without new tasks, blockages
and outages, and with them. A robot that creeps is stuck as well; one that most copies with small
differences let go is not. What only new work frees is *held until new work arrives*: no failure.

Copies without one robot each tell the *members*: robots that hold each other, and whom no other
robot holds. Robots that wait for each other in a ring are members as well, since a stack may
remember the locks of a robot that is gone. Whom members hold are victims. Two or more members are
a *deadlock*, one is *stuck*. A place to which a body does not fit any more, past what was pushed
or who stays there, is *shut by the world*.

A claim states for how long its members were seen, or are proven, to stand. Where the run itself
goes on and refutes that, the claim is withdrawn and told as a contradiction.

Where the run cannot be copied (a recorded trace, a system other than Linux, an open window) one
rule applies. Robots are *suspected* once they and all that they wait for have stood for 30 s. A
suspicion is no failure: the verdict is that the specification was not judged. The same rule applies
to a stack that does not tell where its robots go (see :mod:`.unknown_goals`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import IntArray
from mrta_falsify.core.claims import KINDS
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.protocols import Forecast
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.blocked_by import EDGES_EVERY, look_stride
from mrta_falsify.specs.deadlock.bystanders import WalkWatch
from mrta_falsify.specs.deadlock.counterfactual import (
    COPIES,
    LOOK_AHEAD,
    LOOK_WITHOUT,
    CounterfactualTest,
    FoundDeadlock,
)
from mrta_falsify.specs.deadlock.evidence import (
    Contradiction,
    Deadlock,
    DeadlockEvidence,
    describe,
    edge_rows,
)
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.shut import Ground, Shut
from mrta_falsify.specs.deadlock.suspects import SuspectClock
from mrta_falsify.specs.deadlock.unknown_goals import UnknownGoals
from mrta_falsify.specs.deadlock.wait_graph import (
    EdgesByRobot,
    awaited_by,
    edges_by_robot,
    knots_of,
    victims_of,
)
from mrta_falsify.specs.suspicion import CANNOT_COPY, UNCONFIRMED, awaits_an_end, suspected

SUSPECTED_AFTER = 30.0  # s for which robots and all that they wait for must stand
HALF_LOST_AFTER = 15.0  # s of waiting for a robot, of the half that waiting alone can lose

SPEC = "no_deadlock"


class NoDeadlock:
    """No set of robots waits for itself for good.

    Robustness [s]: 30 s, less the share that is lost. A robot that has waited for another one for
    time t loses ``t / (t + 15 s)`` of one half. Robots that stand with all that they wait for
    lose as much as they have stood, up to 95 %. Only a deadlock that a continuation confirmed
    takes it below 0, to minus the time from its onset to its detection.
    """

    profile = SpecProfile(
        meaning="robots waited for each other for good",
        scale=30.0,
        tie=8,
        in_votes={"copies": 1, "members": False},
    )

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How far a continuation goes, and how many there are."""

        look_ahead: float = quantity(above=0.0, unit="s", default=LOOK_AHEAD)  #: at most
        #: copies of the run that vote at most, the run itself among them; 1: it decides alone
        copies: int = quantity(low=1, default=COPIES)
        #: whether members are told from victims; otherwise all who are stuck are members
        members: bool = True

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._world = world
        self._stride = look_stride(dt)
        self._progress = ProgressClock(world)
        self._suspects = SuspectClock(world, self._progress)
        self._test = CounterfactualTest(
            world,
            dt,
            self._progress,
            self._options.look_ahead,
            copies=self._options.copies,
            members=self._options.members,
        )
        self._dt = dt
        self._unknown_goals: UnknownGoals | None = None  # made where it is needed
        self._forecast: Forecast | None = None
        self._lost = 0.0  # largest share of the robustness
        self._claims: list[_Claim] = []
        self._contradictions: list[Contradiction] = []
        self._suspected: DeadlockEvidence | None = None
        self._missing = ""

    def foresee(self, forecast: Forecast) -> None:
        """See :class:`mrta_falsify.core.protocols.Foreseeing`."""
        self._forecast = forecast

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        if not frame.tells.goals:
            self._missing = "the stack does not tell where its robots are going"
            if self._forecast is None:
                return
            self._unknown_goals = self._unknown_goals or UnknownGoals(self._world, self._dt)
            frame = self._unknown_goals.with_goals(frame, self._forecast)
        self._suspects.watch(frame)
        if frame.sensed.tick % self._stride:
            return
        edges = edges_by_robot(frame.blocked_by)
        self._progress.update(frame)
        self._test.bystanders.update(frame.sensed)
        self._suspects.look(frame, edges)
        self._withdraw(frame)
        self._note_loss()
        if self._forecast is None or self._missing:
            self._suspect(edges, frame)
            return
        self._ask(self._forecast, edges, frame)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        if self._claims:
            claims = sorted((claim.evidence for claim in self._claims), key=_by_gravity)
            first, *others = claims
            return Verdict(
                spec=SPEC,
                robustness=min(first.onset - first.detected_at, -1e-9),
                violated=True,
                violated_at=min(claim.detected_at for claim in claims),
                who=first.members,
                evidence=first.encoded(others) | self._also_known(),
            )
        if self._suspected is not None:
            seen = self._suspected
            why = self._missing or CANNOT_COPY
            return suspected(SPEC, "a deadlock", who=seen.members, evidence=seen.encoded(), why=why)
        if self._missing:
            return unjudged(SPEC, self._missing)
        return Verdict(
            spec=SPEC,
            robustness=SUSPECTED_AFTER * (1.0 - self._lost),
            violated=False,
            evidence=self._also_known(),
        )

    def _also_known(self) -> dict[str, Any]:
        """Give what is told of robots that are in no claim; empty: nothing is."""
        names = [robot.name for robot in self._world.robots]
        held = [
            {"robots": [names[i] for i in row.robots], "since": row.since, "until": row.until}
            for row in self._test.held
        ]
        refuted = codec.encode(tuple(self._contradictions))
        rows = {"held_until_work": held, "contradictions": refuted}
        return {name: found for name, found in rows.items() if found}

    def _note_loss(self) -> None:
        wait = self._suspects.longest_wait()
        closed = float(self._suspects.closed_for().max(initial=0.0))
        self._lost = max(
            self._lost,
            0.5 * wait / (wait + HALF_LOST_AFTER),
            min(closed / SUSPECTED_AFTER, UNCONFIRMED),
        )

    def _ask(self, forecast: Forecast, edges: EdgesByRobot, frame: Frame) -> None:
        """Ask for a forecast if a robot may be stuck about which nothing is known yet."""
        time = frame.sensed.time
        self._test.note(time, self._suspects.waits)
        known = {i for claim in self._claims for i in claim.deadlock.robots}
        is_last = time > self._world.horizon - EDGES_EVERY
        asked = {
            i
            for i in self._suspects.suspects(is_last=is_last) - known
            if self._test.is_open(i, time)
            and not awaited_by(i, range(len(self._world.robots)), edges) & known
        }
        if not asked:
            return
        for found in self._test.deadlocks(forecast, asked, time, edges):
            if not known & set(found.group.robots):
                self._claim(found, forecast, edges, frame)

    def _suspect(self, edges: EdgesByRobot, frame: Frame) -> None:
        """Suspect a deadlock where no forecast can tell, or drop a suspicion."""
        self._suspected = None
        closed_for = self._suspects.closed_for()
        stuck = set((closed_for >= SUSPECTED_AFTER).nonzero()[0].tolist())
        if not stuck or awaits_an_end(self._world, frame.sensed.time):
            return
        members = knots_of(stuck, edges)[0]
        deadlock = Deadlock(
            members=members,
            victims=tuple(sorted(victims_of(members, stuck, edges))),
            edges=edges,
            onsets={i: frame.sensed.time - float(closed_for[i]) for i in members},
            confirmed=False,
        )
        self._suspected = describe(deadlock, self._world, frame, edges)

    def _claim(
        self, found: FoundDeadlock, forecast: Forecast, edges: EdgesByRobot, frame: Frame
    ) -> None:
        """Claim a deadlock that continuations have shown."""
        time = frame.sensed.time
        ground = Ground(
            world=self._world,
            pose=frame.sensed.pose,
            discs=forecast.discs,
            bystanders=found.bystanders,
            stands_since=time,
            ended=found.ended,
        )
        deadlock = _with_last_links(_confirmed(found, time), ground)
        names = [robot.name for robot in self._world.robots]
        described = describe(deadlock, self._world, frame, edges)
        shut = _shut(found, ground, frame)
        if shut and self._is_let_go(forecast, shut.by, found.group.robots):
            shut = None  # a person stands there because the robots do
        is_ring = set(found.members_alone) == set(found.group.members)
        evidence = dataclasses.replace(
            described,
            kind="shut" if shut else described.kind,
            shut_room=shut.room if shut else "",
            shut_by=shut.by if shut else (),
            shut_since=shut.since if shut else None,
            stands_for=found.ended - time,
            for_good=found.proven,
            cycle_seen=edge_rows(found.group.members, found.seen, self._world),
            members_alone=() if is_ring else tuple(names[i] for i in sorted(found.members_alone)),
        )
        self._claims.append(_Claim(deadlock, evidence, frame.served.copy()))

    def _is_let_go(self, forecast: Forecast, names: Collection[str], robots: Sequence[int]) -> bool:
        """Whether one of the people among ``names`` walks on once ``robots`` are gone."""
        people = [h for h, human in enumerate(self._world.humans) if human.name in names]
        if not people:
            return False
        answer = forecast(WalkWatch(people, LOOK_WITHOUT), without=robots)
        return answer is not None and bool(answer["walked"])

    def _withdraw(self, frame: Frame) -> None:
        """Withdraw the claims that the run refutes: a member goes on within the claim's bound."""
        time = frame.sensed.time
        for claim in list(self._claims):
            seen = claim.evidence
            bound = np.inf if seen.for_good or seen.stands_for is None else seen.stands_for
            if time > seen.detected_at + bound:
                continue
            members = np.array(claim.deadlock.members)
            # Creep is no way driven, nor is a goal that the robot never drove to.
            on_the_way = np.minimum(self._progress.on_the_way(), self._progress.moved)
            goes_on = on_the_way[members] > seen.detected_at
            goes_on |= frame.served[members] > claim.served[members]
            if goes_on.any():
                self._claims.remove(claim)
                robot = self._world.robots[int(members[goes_on][0])].name
                self._contradictions.append(
                    Contradiction(
                        members=seen.members,
                        kind=seen.kind,
                        claimed_at=seen.detected_at,
                        refuted_at=time,
                        robot=robot,
                    )
                )


class _Claim(NamedTuple):
    """A claim that stands so far."""

    deadlock: Deadlock
    evidence: DeadlockEvidence
    served: IntArray  #: (N,) stops done when it was made


def _with_last_links(deadlock: Deadlock, ground: Ground) -> Deadlock:
    """Add what holds idle robots that stand in the way and could not make room."""
    edges = dict(deadlock.edges)
    for i in sorted(deadlock.awaited() - deadlock.robots):
        own = [edge for edge in edges.get(i, ()) if edge.cause != "task"]
        by = () if own else ground.shut_in(i)
        edges[i] = own or [BlockedBy(i, "no-path", -1, name) for name in by]
    return dataclasses.replace(deadlock, edges=edges)


def _shut(found: FoundDeadlock, ground: Ground, frame: Frame) -> Shut | None:
    """Say what shuts the ways of all members; None: the way of one is not shut by the world."""
    ways = [ground.shut_way(i, frame.intent.goal[i]) for i in found.group.members]
    shut = [way for way in ways if way is not None]
    if len(shut) < len(found.group.members):
        return None
    return min(shut, key=lambda way: way.since)


def _by_gravity(evidence: DeadlockEvidence) -> tuple[int, float]:
    return KINDS.index(evidence.kind), evidence.onset


def _confirmed(found: FoundDeadlock, time: float) -> Deadlock:
    """Describe a deadlock by the edges at the end of its forecast, of robots that stand now."""
    members, robots = found.group
    return Deadlock(
        members=members,
        victims=tuple(i for i in robots if i not in members),
        edges={i: own for i, own in found.edges.items() if found.last.get(i, time) <= time},
        onsets={i: found.last[i] for i in members},
        confirmed=True,
    )
