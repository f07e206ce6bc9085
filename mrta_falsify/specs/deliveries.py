"""Deliveries: all of them, and in time."""

from __future__ import annotations

from mrta_falsify.core.fleet import Frame, Refusal
from mrta_falsify.core.registry import WithoutOptions
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import Ledger, encoded


class ByTheBooks(WithoutOptions):
    """A specification of what the books hold; without deliveries told it cannot be judged."""

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._world, self._dt, self._time = world, dt, 0.0
        self._ledger, self._missing = Ledger(world), ""
        self._claims: list[Refusal] = []  # of stops, refused

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._time = frame.sensed.time
        self._missing = "" if all(frame.tells) else frame.tells.lacking("deliveries")
        if frame.confirmed:
            self._ledger.enter(frame.confirmed, frame.sensed.time)
        self._claims += frame.refused


class AllTasksDone(ByTheBooks):
    """Every task is delivered before the horizon.

    Robustness is a share. If all is delivered, it is the share of the horizon that was left.
    Before the horizon it is the share still left; at the horizon, minus the share of open tasks.
    """

    profile = SpecProfile(meaning="not all tasks were delivered", role="outcome", tie=14)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        if self._missing:
            return unjudged("all_tasks_done", self._missing)
        horizon, ledger = self._world.horizon, self._ledger
        left, due = ledger.open, ledger.due
        over = self._world.is_over(self._time, self._dt)
        if not left:
            robustness = max(0.0, 1.0 - max(ledger.delivered.values(), default=0.0) / horizon)
        elif over:
            robustness = -len(left) / len(due)
        else:
            robustness = max(0.0, 1.0 - self._time / horizon)
        return Verdict(
            spec="all_tasks_done",
            robustness=robustness,
            violated=robustness < 0.0,
            violated_at=self._time if robustness < 0.0 else None,
            who=tuple(f"task{i}" for i in left) if robustness < 0.0 else (),
            evidence={
                "total": len(due),
                "delivered": len(due) - len(left),
                "open": list(left),
                "picked_up": sorted(set(left) & set(ledger.picked)),
                "claims_refused": encoded(self._claims),
            },
        )


class Deadlines(ByTheBooks):
    """Every task is delivered by its deadline.

    Robustness [s]: smallest margin; for an open task that has arrived, the time left to it.
    """

    profile = SpecProfile(meaning="a deadline was missed", scale=120.0, role="outcome", tie=13)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        if self._missing:
            return unjudged("deadlines", self._missing)
        delivered = self._ledger.delivered
        margins = self._ledger.margins(self._time)
        worst = min(margins.values(), default=self._world.horizon)
        late = sorted(i for i, margin in margins.items() if margin < 0.0)
        tasks = self._world.tasks
        return Verdict(
            spec="deadlines",
            robustness=worst,
            violated=worst < 0.0,
            violated_at=min((tasks[i].deadline for i in late), default=None),
            who=tuple(f"task{i}" for i in late),
            evidence={
                "margins": {f"task{i}": margin for i, margin in margins.items()},
                "late": [
                    {
                        "task": i,
                        "deadline": tasks[i].deadline,
                        "delivered": delivered.get(i),
                        "robot": self._robot(i),
                    }
                    for i in late
                ],
            },
        )

    def _robot(self, task: int) -> str:
        robot = self._ledger.by.get(task, -1)
        return self._world.robots[robot].name if robot >= 0 else ""
