"""Runs of smaller worlds in the lab, and whether they still fail in the same way."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from mrta_falsify.campaigns.signature import mechanism
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.lab import Course, Experiment, Lab, RunResult, experiment_of_job
from mrta_falsify.perturbed_runs import fate_on_other
from mrta_falsify.specs.causes import is_shut, leading
from mrta_falsify.trial import Job

PERTURBED = 10  # runs of a world with small differences that vote on it


class OutOfRunsError(Exception):
    """An answer is not known yet, and the runs are used up."""


class Smaller(NamedTuple):
    """A world that may still fail."""

    world: World
    what: str  #: that it is without
    place: int = 0  #: of what is left out, in its group


class _Answer(NamedTuple):
    """What the runs of a smaller world say."""

    course: Course | None  #: of its run, if it fails in the wanted way
    runs: int  #: it took


@dataclass(slots=True)
class Reruns:
    """Runs worlds and says which is the first that still fails in the wanted way.

    The next few worlds run side by side, one for each worker of the lab. The first in their order
    that fails counts, so the answer is the same as with one worker. An answer of an earlier call is
    taken when this call would run its world, and counts as that run, so a second call takes the
    steps of the first again.
    """

    lab: Lab
    job: Job
    verdict: Verdict  #: the violated one that explains the failure
    wanted: str  #: mechanism of the failure
    max_runs: int
    on_run: Callable[[int, str], None]
    other: StackConfig | None = None  #: must pass where the other one fails; None: any may fail
    count: int = field(init=False, default=0)  #: simulated, including earlier calls
    _known: dict[str, _Answer] = field(init=False, default_factory=dict)  #: by digest of the world
    _counted: set[str] = field(init=False, default_factory=set)  #: perturbed runs, by digest

    def first_failing(self, worlds: Iterable[Smaller]) -> tuple[Smaller, Course] | None:
        """Find the first of ``worlds`` that fails in the wanted way.

        Args:
            worlds: in the order in which they are wanted; taken as they are needed.

        Returns:
            The world and the course of its run; None if none fails.

        Raises:
            OutOfRunsError: an answer that is needed is not known, and the runs are used up.
            HarnessError: a process died.
        """
        rest, known = iter(worlds), self._known
        while batch := list(self._next_batch(rest)):
            self._run({key: smaller for key, smaller in batch if key not in known})
            for key, smaller in batch:
                if key not in known:
                    raise OutOfRunsError
                course = known[key].course
                if course is not None:
                    return smaller, course
        return None

    def knows(self, world: World) -> bool:
        """Whether a world was run."""
        return world.digest() in self._known

    def is_robust(self, world: World) -> bool:
        """Whether most runs of a world with small differences fail.

        Raises:
            OutOfRunsError: there are not enough runs left to say.
        """
        if self.max_runs - self.count < PERTURBED:
            raise OutOfRunsError
        own = self._experiment(world, perturbed=True)
        vote = self.lab.vote(own, PERTURBED, self._repeats)
        for number in range(1, 1 + vote.runs + vote.undecided):
            self._spend_once(own.with_perturbation(number))
        return vote.robust

    def perturbed(self, world: World) -> tuple[bool, ...]:
        """Run a world with small differences; whether each run fails, of those that tell."""
        own = self._experiment(world, perturbed=True)
        copies = [own.with_perturbation(1 + k) for k in range(PERTURBED)]
        fails = []
        for copy, result in zip(copies, self.lab.map(copies), strict=True):
            fails.append(self._repeats(result))
            self._spend_once(copy)
        return tuple(failed for failed in fails if failed is not None)

    def _experiment(self, world: World, *, perturbed: bool = False) -> Experiment:
        own = dataclasses.replace(experiment_of_job(self.job), world=world)
        return own.for_vote() if perturbed else dataclasses.replace(own, with_course=True)

    def _repeats(self, result: RunResult) -> bool | None:
        """Whether a run violates the same specification; None: it tells nothing."""
        own = [verdict for verdict in result.verdicts if verdict.spec == self.verdict.spec]
        if not own or any(verdict.not_judged for verdict in own):
            return None
        return any(v.violated and is_shut(v) == is_shut(self.verdict) for v in own)

    def _next_batch(self, rest: Iterator[Smaller]) -> Iterator[tuple[str, Smaller]]:
        """Take worlds up to one that is known to fail, at most one unknown for each worker."""
        unknown = set()
        for smaller in rest:
            key = smaller.world.digest()
            yield key, smaller
            answer = self._known.get(key)
            if answer is None:
                unknown.add(key)
            elif answer.course is not None:
                return
            if len(unknown) == self.lab.workers:
                return

    def _run(self, asked: dict[str, Smaller]) -> None:
        cost = 1 if self.other is None else 2  # simulations, at most
        left = max(0, self.max_runs - self.count) // cost
        chosen = dict(itertools.islice(asked.items(), left))
        experiments = [self._experiment(smaller.world) for smaller in chosen.values()]
        results = self.lab.map(experiments)
        for (key, smaller), own, result in zip(chosen.items(), experiments, results, strict=True):
            answer = self._answer(own, result)
            self._known[key] = answer
            if answer.runs:
                outcome = "fails" if answer.course is not None else "passes"
                self._spend(answer.runs, f"{outcome} without {smaller.what}")

    def _answer(self, own: Experiment, result: RunResult) -> _Answer:
        if result.status == "impossible":
            return _Answer(None, 0)
        if result.status == "error":
            raise HarnessError(result.detail)
        if leading(result.verdicts) is None or mechanism(result.verdicts) != self.wanted:
            return _Answer(None, 1)
        if self.other is None:
            return _Answer(result.course, 1)
        theirs = self.lab.run(dataclasses.replace(own, stack=self.other, with_course=False))
        if theirs.status == "error":
            raise HarnessError(theirs.detail)
        passes = fate_on_other(self.verdict, theirs) == "passes" and theirs.status != "impossible"
        return _Answer(result.course if passes else None, 2)

    def _spend_once(self, copy: Experiment) -> None:
        """Count a perturbed run, unless it was counted before."""
        key = copy.digest()
        if key not in self._counted:
            self._counted.add(key)
            self._spend(1, "one more run with small differences")

    def _spend(self, runs: int, text: str) -> None:
        self.count += runs
        self.on_run(self.count, text)
