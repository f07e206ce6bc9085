"""Runs of points of a program, with answers that outlive the process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mrta_falsify.campaigns.journal import append_row, read_rows
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

SCENES = 300  # attempts at a valid scene before a point is given up

Box = dict[int, tuple[float, float]]  # share of a dimension's range, by its number


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a run has shown."""

    u: Array  #: ``(k,)`` the point that was run, after repair
    failed: bool  #: with the wanted signature


@dataclass(slots=True)
class Runs:
    """Runs points of a program and says whether they fail in the wanted way.

    Answers are kept in ``cache``, a line each, before they are given; whoever asks for the same
    points again, in this process or a later one, gets them without a run.
    """

    settings: TrialSettings
    program: Program
    config: StackConfig
    wanted: str
    cache: Path
    on_run: Callable[[int], None]
    count: int = 0  #: answers that took a run, now or earlier
    known: dict[str, Answer | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for row in read_rows(self.cache):
            try:
                self.known[str(row["run"])] = _answer(row)
            except (ValueError, KeyError, TypeError):
                continue  # a damaged line costs one run

    def within(self, box: Box, candidate: Candidate) -> Answer | None:
        """Run a candidate of the program restricted to a box; None: it has no valid scene.

        Args:
            box: least and largest share of a dimension's range, by its number.
            candidate: its ``u`` is a point of the box.
        """
        self.program.restrict(box)
        try:
            return self.of(self.program, candidate, box)
        finally:
            self.program.restrict({})

    def of(
        self, program: Program, candidate: Candidate, box: Box, *, noise_seed: int | None = None
    ) -> Answer | None:
        """Run a candidate of a program; None: it has no valid scene.

        Args:
            program: the campaign's one, restricted to ``box`` by whatever means.
            candidate: of ``program``.
            box: names the restriction.
            noise_seed: that ``program`` fixes.
        """
        key = self._key(candidate, box, noise_seed)
        if key not in self.known:
            self.known[key] = self._run(program, candidate)
            self._keep(key)
        answer = self.known[key]
        if answer is not None:
            self.count += 1
            self.on_run(self.count)
        return answer

    def _run(self, program: Program, candidate: Candidate) -> Answer | None:
        try:
            realised = program.realise(candidate, max_attempts=SCENES)
        except InputError:
            return None
        job = Job(
            world=realised.world,
            config=self.config,
            specifications=specifications_of(self.settings),
            early_stop=True,
            scene=realised.scene,
        )
        try:
            failed = signature(judge(job, keep_trace=False).verdicts) == self.wanted
        except InputError:
            failed = False  # a world in which the stack cannot begin
        return Answer(realised.candidate.u, failed)

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

    def _keep(self, key: str) -> None:
        answer = self.known[key]
        row: dict[str, Any] = {"run": key, "u": None, "failed": False}
        if answer is not None:
            row |= {"u": answer.u.tolist(), "failed": answer.failed}
        append_row(self.cache, row)


def _answer(row: dict[str, Any]) -> Answer | None:
    if row["u"] is None:
        return None
    return Answer(np.array(row["u"], dtype=np.float64), bool(row["failed"]))
