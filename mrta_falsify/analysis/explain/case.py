"""A failure that is to be explained, and what is asked about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from mrta_falsify.analysis.explain.changes import Change
from mrta_falsify.analysis.explain.rows import Failure
from mrta_falsify.core.findings import Explanation
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.lab import Experiment, Lab
from mrta_falsify.trial import Job


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """A failure with the run that shows it."""

    job: Job  #: that fails
    own: Experiment  #: its run
    verdict: Verdict  #: the violated one that explains the failure
    trace: Trace  #: of the run
    failure: Failure  #: as runs with small differences are asked about it
    guess: str  #: the layer that the trace alone points to
    #: a moment shortly before the onset [s]; 0 where what cost the time may be anywhere
    before_onset: float
    at: float  #: when a layer is exchanged first [s]: that, or 0 where the stack is one whole
    changes: tuple[Change, ...]  #: of layers that may be exchanged
    rewinds: int  #: runs beside the others that tell when the failure was decided
    lab: Lab  #: that runs whatever is asked


class Question(Protocol):
    """One thing that is asked about a failure by changed runs.

    A new one is a class with these members, and a place in ``QUESTIONS`` in ``explaining``. What
    it finds is told by ``sentences``; terminal, Markdown and page print those, JSON has all fields.
    """

    @property
    def least(self) -> int:
        """Runs set aside for it, whatever comes before it; it gets more if that leaves some.

        Its place in ``QUESTIONS`` never leaves it without runs.
        """

    def applies(self, case: Case) -> bool:
        """Whether it says anything about a failure."""

    def ask(self, case: Case, found: Explanation, runs: int) -> Explanation:
        """Run what is needed by ``case.lab``, and add what it says.

        Args:
            case: of the failure.
            found: by the questions before it.
            runs: at most.

        Returns:
            ``found`` with its own fields filled.
        """
