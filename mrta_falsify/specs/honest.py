"""What a stack tells of itself must not contradict what its robots do."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.config import DISPATCHER
from mrta_falsify.core.fleet import Frame, StackEvent
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.words import number_text
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import (
    MAX_REFUSALS,
    ROUNDING,
    STOP_KINDS,
    Refusals,
    encoded,
    unknown_in,
)
from mrta_falsify.specs.deliveries import ByTheBooks

MISDATED = 1.0  # s between an event's own time and the tick that brings it; links take less


class HonestEvents(ByTheBooks):
    """No event contradicts motion, geometry or the world.

    Refused pick-ups and deliveries count (see :mod:`mrta_falsify.specs.books`), and so do

    - robots and tasks that do not exist, tasks assigned before they arrive;
    - robots that are said to have joined before they do;
    - a deadline said to be missed that is not over, or was kept;
    - an event dated over 1 s away from the tick that brings it.

    Decisions are no claims. Who holds a room is for the stack to say, and ``exclusive_use`` judges
    what comes of it.

    Robustness: minus the number of contradicted claims, repeated ones counted once; 1 without any.
    """

    profile = SpecProfile(
        meaning="the stack said what its robots did not do", tie=2, layer=DISPATCHER
    )

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        super().start(world, dt)
        self._refused = Refusals(world)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        super().update(frame)
        for event in frame.events:
            reason = self._objection(event, frame)
            if reason:
                self._refused.add(event, frame.sensed.time, reason)

    def _objection(self, event: StackEvent, frame: Frame) -> str:
        """Say what contradicts an event, empty: nothing does, or the books say it."""
        time = frame.sensed.time
        if abs(event.time - time) > MISDATED:
            return f"misdated: it says {event.time:.1f} s"
        if event.kind in STOP_KINDS:
            return ""
        unknown = unknown_in(event, self._world, must_name=False)
        if unknown:
            return unknown
        if event.kind == "joined" and event.robot >= 0:
            joins_at = self._world.robots[event.robot].joins_at
            return f"it joins at {number_text(joins_at)} s" if time < joins_at - ROUNDING else ""
        return self._objection_of_task(event, time) if event.task >= 0 else ""

    def _objection_of_task(self, event: StackEvent, time: float) -> str:
        task = self._world.tasks[event.task]
        if task.arrival > time + ROUNDING:
            return "the task has not arrived"
        if event.kind != "deadline-missed":
            return ""
        if time <= task.deadline:
            return f"the deadline is at {number_text(task.deadline)} s"
        delivered = self._ledger.delivered.get(event.task, np.inf)
        return f"delivered in time: at {delivered:.1f} s" if delivered <= task.deadline else ""

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        if self._missing:
            return unjudged("honest_events", self._missing)
        rows = [*encoded(self._claims), *encoded(self._refused.rows)]
        rows.sort(key=lambda row: (row["time"], row["kind"], row["task"], row["robot"]))
        count = len(self._claims) + len(self._refused.rows)
        return Verdict(
            spec="honest_events",
            robustness=float(-count) if count else 1.0,
            violated=count > 0,
            violated_at=rows[0]["time"] if rows else None,
            who=tuple(sorted({row["robot"] for row in rows if row["robot"]})),
            evidence={"claims": rows[:MAX_REFUSALS], "count": count},
        )
