"""Runs of points of a program, with answers that outlive the process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.trial import Job, judge
from mrta_falsify.worker import specifications_of

if TYPE_CHECKING:
    from scenic_worlds.program import Program

SCENE_ATTEMPTS = 300  # attempts at a valid scene before a point is given up

Box = dict[int, tuple[float, float]]  # lowest and highest share of a dimension's range, by number


@dataclass(frozen=True, slots=True, eq=False)
class PointRun:
    """What the run of a point gave."""

    u: Array | None  #: ``(k,)`` the point that was run, after repair; None: no valid scene
    failed: bool  #: with the wanted signature


@dataclass(slots=True)
class SampleRuns:
    """Runs points of a program and says whether they fail in the wanted way.

    A point that was asked for before, in this process or an earlier one, is not run again.
    """

    settings: TrialSettings
    program: Program
    config: StackConfig
    wanted: str  #: signature
    journal: RunJournal[PointRun]
    on_run: Callable[[int], None]
    count: int = 0  #: samples that took a run, now or earlier

    def within(self, box: Box, candidate: Candidate) -> PointRun:
        """Run a candidate of the program restricted to a box.

        Args:
            box: the restriction.
            candidate: its ``u`` is a point of the box.
        """
        self.program.restrict(box)
        try:
            return self.of(self.program, candidate, box)
        finally:
            self.program.restrict({})

    def of(
        self, program: Program, candidate: Candidate, box: Box, *, noise_seed: int | None = None
    ) -> PointRun:
        """Run a candidate of a program.

        Args:
            program: the campaign's one, restricted to ``box`` by whatever means.
            candidate: of ``program``.
            box: names the restriction.
            noise_seed: that ``program`` fixes.
        """
        key = self._key(candidate, box, noise_seed)
        sample = self.journal.answers.get(key)
        if sample is None:
            sample = self.journal.keep(key, self._run(program, candidate))
        if sample.u is not None:
            self.count += 1
            self.on_run(self.count)
        return sample

    def _run(self, program: Program, candidate: Candidate) -> PointRun:
        try:
            realised = program.realise(candidate, max_attempts=SCENE_ATTEMPTS)
        except InputError:
            return PointRun(u=None, failed=False)
        job = Job(
            world=realised.world,
            config=self.config,
            specifications=specifications_of(self.settings),
            early_stop=True,
            then=self.settings.then,
            scene=realised.scene,
            limits=self.settings.limits,
        )
        try:
            failed = signature(judge(job, keep_trace=False).verdicts) == self.wanted
        except InputError:
            failed = False  # a world in which the stack cannot begin
        return PointRun(u=realised.candidate.u, failed=failed)

    def _key(self, candidate: Candidate, box: Box, noise_seed: int | None) -> str:
        asked = {
            "sources": self.program.sources_digest,
            "params": self.settings.params,
            "stack": self.config,
            "specifications": specifications_of(self.settings),
            "wanted": self.wanted,
            "box": [[i, *box[i]] for i in sorted(box)],
            "noise_seed": noise_seed,
            "candidate": candidate,
        }
        return codec.digest(asked)
