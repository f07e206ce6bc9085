"""What reports, and pictures of runs, are made from, as values; renderers turn them into pages."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.candidate import DimensionValue
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.findings import Counterfactual, LayerRow
from mrta_falsify.core.importance import Group
from mrta_falsify.core.inevitability import Inevitability
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorKind:
    """Trials in which the toolkit failed for one reason."""

    reason: str  #: one line
    ids: tuple[str, ...]
    text: str = ""  #: of the first of them, in full


@dataclass(frozen=True, slots=True, kw_only=True)
class Neighbour:
    """The passing trial nearest to a failure."""

    id: str
    differences: tuple[tuple[str, str, str], ...]  #: parameter, value here and value there
    further: int  #: parameters that differ less
    command: str  #: that runs it again and shows it beside the failure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CaseContents:
    """One run as the report shows it; a failure unless it is the case of a single run."""

    id: str
    signature: str
    world: World
    trace: Trace
    verdicts: tuple[Verdict, ...]
    facts: tuple[tuple[str, str], ...]  #: label and text: digests, seeds, engine, versions
    commands: tuple[tuple[str, str], ...]  #: what each does, and the command
    costmap: Costmap | None = None  #: at time 0
    layer: str = ""  #: suspected
    layer_evidence: str = ""  #: a sentence or two on why
    counterfactuals: tuple[Counterfactual, ...] = ()  #: of explanations that have no rows
    rows: tuple[LayerRow, ...] = ()  #: the stack as it is, and with one layer exchanged
    removals: tuple[str, ...] = ()  #: who goes on without which robot, in words
    needs: tuple[str, ...] = ()  #: without what, and under which schedule, it fails, in sentences
    certified: tuple[str, ...] = ()  #: what a certificate proves, in sentences
    inevitability: Inevitability | None = None  #: None: the run was not rewound
    decided: tuple[str, ...] = ()  #: when it was decided, and by which layer, in sentences
    identical: tuple[int, int] | None = None  #: replays with the same digest, of how many
    parts: str = ""  #: where the first differing replay parts from the stored trace
    jittered: tuple[int, int] | None = None  #: failures among jittered copies, of how many
    repeated: str = ""  #: how often the same run failed again, in words
    confirmed: str = ""  #: on which other engines it fails, in words
    removed: tuple[str, ...] = ()  #: by the minimiser, in words
    tried: str = ""  #: what the minimiser tried, and how often its world fails
    counts: tuple[tuple[str, int, int], ...] = ()  #: kind of thing, how many before and after it
    minimised: CaseContents | None = None
    other: CaseContents | None = None  #: the other stack's run of the same world, if two are shown
    neighbour: Neighbour | None = None  #: None: no trial passes
    passing: CaseContents | None = None  #: the neighbour's run, where it was kept
    compared: tuple[str, ...] = ()  #: what the other stack does, and what copies say, in words


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mode:
    """Failures with one signature; some of them in full."""

    signature: str
    ids: tuple[str, ...]
    cases: tuple[CaseContents, ...]
    happened: str = ""  #: in the first of them, in one sentence
    layers: tuple[str, ...] = ()  #: suspected in its trials, the most frequent first


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialScores:
    """All judged trials of a campaign, in order."""

    numbers: tuple[int, ...]
    scores: tuple[float, ...]
    failed: tuple[bool, ...]
    places: np.ndarray  #: (n, 2) where each came closest to trouble [m]
    deadlocked: tuple[bool, ...] = ()  #: empty: not known
    situations: tuple[int, ...] = ()  #: different ones seen so far; empty: not known


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterImportance:
    """How much of the variance of failing one parameter explains."""

    name: str
    share: float  #: estimate, in [0, 1]
    low: float  #: of the interval
    high: float
    matters: bool  #: failing goes with it beyond chance
    values: tuple[float | None, ...]  #: of the judged trials, in order; of a choice, its number
    options: tuple[str, ...]  #: what each choice is
    parts: tuple[Group, ...]  #: of its range, in the units of the values


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRow:
    """One trial of the table of all trials."""

    id: str
    outcome: str  #: deadlock, stuck, shut, failure, pass, rejected, impossible or error
    mode: int  #: number of its failure mode, from 1; 0: none
    found: float | None  #: when the violation was found [s]
    score: float | None  #: None: not judged
    simulated: float  #: [s]
    values: tuple[DimensionValue, ...]  #: of the parameters


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialTable:
    """All trials of a campaign with the values of their parameters."""

    parameters: tuple[str, ...]  #: names, the most important first
    rows: tuple[TrialRow, ...]
    note: str = ""  #: what is left out, or what the values are


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table with a heading."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()  #: above it
    folded: bool = False  #: shown only when the reader opens it


@dataclass(frozen=True, slots=True, kw_only=True)
class EmbeddedImage:
    """A picture inside the page."""

    title: str
    uri: str  #: data address
    alt: str  #: what it shows, in words


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReportContents:
    """Everything the page of a campaign, or of a single run, says."""

    title: str
    headline: str
    facts: tuple[tuple[str, str], ...]
    modes: tuple[Mode, ...] = ()
    trials: TrialScores | None = None
    importances: tuple[ParameterImportance, ...] = ()  #: the largest first
    even: bool = True  #: these are of trials that were drawn evenly
    table: TrialTable | None = None  #: None: there are no trials, or only one run
    summary: tuple[str, ...] = ()  #: sentences for someone who knows nothing of the campaign
    counted_by: str = ""  #: command that tells the same again from the stored trials
    run: CaseContents | None = None  #: the only case, where the report is of a single run
    errors: tuple[ErrorKind, ...] = ()  #: what the toolkit failed at
    floor: World | None = None  #: whose floor the coverage map shows
    stack: str = ""  #: YAML
    other_stack: str = ""  #: YAML, of the stack that failures are compared with
    versions: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()  #: what the numbers do not say
    warnings: tuple[str, ...] = ()  #: what a reader must know first
    tables: tuple[Table, ...] = ()  #: further tables
    images: tuple[EmbeddedImage, ...] = ()  #: pictures and animations
    refresh: int = 0  #: after how many seconds an open page loads itself again; 0: never
    beside: dict[str, str] = field(default_factory=dict)  #: pages of further cases, by trial
    whole: str = ""  #: page of the campaign, where this is the page of one of its cases

    @property
    def unjudged(self) -> bool:
        """Whether the report is of a single run, and something of it was not judged."""
        return self.run is not None and any(verdict.not_judged for verdict in self.run.verdicts)

    @property
    def failed(self) -> bool:
        """Whether the report tells of a violation."""
        if self.run is not None:
            return any(verdict.violated for verdict in self.run.verdicts)
        return bool(self.modes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunView:
    """What pictures and pages of one run are made from."""

    world: World
    trace: Trace
    verdicts: tuple[Verdict, ...] = ()
    costmap: Costmap | None = None  #: at time 0
    facts: tuple[tuple[str, str], ...] = ()  #: label and text, shown in this order


def kept_column(trace: Trace, name: str) -> np.ndarray | None:
    """Column of a trace; None if the trace was not kept, or is empty."""
    column = trace.columns.get(name)
    return column if column is not None and len(column) else None
