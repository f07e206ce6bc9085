"""One cell that has changed: its known failures are run again, and its scenario is searched."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
from collections.abc import Iterator
from pathlib import Path

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.rules import JUDGED_SINCE
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.campaigns.store import SETTINGS, Campaign, owner_of, read_campaign_settings
from mrta_falsify.commands.campaign import OnFeedback, open_store, run_store
from mrta_falsify.commands.ci.cells import Cell, example_of, search_folder
from mrta_falsify.commands.ci.ledger import MAX_EXAMPLES, CellState, Example, Fate, Finding, merged
from mrta_falsify.commands.ci.project import Project
from mrta_falsify.commands.corpus import on_recorded_engine, recheck
from mrta_falsify.commands.trust import Trust, open_to_run, permit_rechecks
from mrta_falsify.commands.workers import local_workers
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Recheck
from mrta_falsify.core.interruption import Interrupted
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.lab import Vote
from mrta_falsify.specs.causes import kind_of, leading
from reports.sentences import violation_sentence

NO_RESULT = "ci has no result; the same command goes on"


class CellRun:
    """One cell that has changed: its known failures run again, and its search."""

    def __init__(
        self,
        project: Project,
        cell: Cell,
        known: tuple[Finding, ...],
        number: int,
        journal: RunJournal[Recheck],
        workers: int,
        trust: Trust = False,
    ) -> None:
        self._project, self._cell, self._number = project, cell, number
        self._known = known
        self._journal, self._workers = journal, workers
        self._trust = trust
        self.trials = self.rechecked = 0

    def state(self, on_feedback: OnFeedback) -> CellState:
        """Run it."""
        # what the search finds goes first: its examples are stored failures of their own mode
        seen = list(self._search(on_feedback)) if self._cell.search is not None else []
        undecided: list[str] = []
        for finding in self._known:
            for example, row in self._rechecked(finding):
                self.rechecked += 1
                reported = _finding_of(finding, example, row, self._number)
                if reported is None:
                    undecided.append(finding.signature)
                elif reported.fate != "resolved":
                    seen.append(reported)
        found = merged(self._known, seen, undecided, self._number)
        return CellState(
            name=self._cell.name,
            parts=self._cell.parts,
            findings=tuple(self._with_few_examples(finding) for finding in found),
        )

    def _with_few_examples(self, finding: Finding) -> Finding:
        most = None if self._cell.search is None else MAX_EXAMPLES
        return dataclasses.replace(finding, examples=finding.examples[:most])

    def _rechecked(self, finding: Finding) -> Iterator[tuple[Example, Recheck]]:
        """Yield the stored failures of a mode, run again."""
        queried = {self._key(example): example for example in finding.examples}
        missing = [example for key, example in queried.items() if key not in self._journal.answers]
        for directory in sorted({example.directory for example in missing}):
            ids = [example.id for example in missing if example.directory == directory]
            campaign = open_to_run(self._project.folder / directory, self._trust)
            engine = on_recorded_engine(campaign, StackConfig())
            is_kept = engine.engine == self._cell.config.engine
            permit_rechecks(campaign, engine if is_kept else StackConfig(), self._trust, only=ids)
            for row in recheck(
                campaign,
                config=self._cell.config,
                jittered=self._cell.jittered,
                workers=self._workers,
                only=ids,
            ):
                self._journal.keep(self._key(Example(directory, row.id)), row)
        for key, example in queried.items():
            yield example, self._journal.answers[key]

    def _key(self, example: Example) -> str:
        return codec.digest([self._cell.digest, example, self._cell.jittered])

    def _search(self, on_feedback: OnFeedback) -> Iterator[Finding]:
        """Search the scenario, or go on where a search with the same settings stopped."""
        cell = self._cell
        assert cell.search is not None
        folder = search_folder(cell)
        _forget_other_settings(folder, cell)
        limits = Limits(budget=cell.search.budget, stop_after=cell.stop_after)
        with open_store(folder, cell.search) as store:
            result = run_store(store, limits, local_workers(self._workers), on_feedback=on_feedback)
        if result.ended == "interrupted":
            raise Interrupted(
                kept=f"{result.progress.ran} trials of {cell.name}", missing=NO_RESULT
            )
        self.trials = result.progress.ran
        yield from _found_by(self._project, result.campaign, self._number)


def _forget_other_settings(folder: Path, cell: Cell) -> None:
    """Delete a search that another checkout has left: its paths are not ours."""
    if not (folder / SETTINGS).is_file() or owner_of(folder):
        return
    with contextlib.suppress(InputError):
        if codec.digest(read_campaign_settings(folder)) == codec.digest(cell.search):
            return
    shutil.rmtree(folder)


def _found_by(project: Project, campaign: Campaign, number: int) -> Iterator[Finding]:
    """Yield the failure modes of a search."""
    by_id = {record.id: record for record in campaign.records}
    for mode in campaign.stats().modes:
        records = [by_id[name] for name in mode.ids]
        verdict = leading(records[0].verdicts)
        assert verdict is not None
        fate: Fate = "failing" if any(map(_is_sure, records)) else "flaky"
        yield Finding(
            signature=signature(records[0].verdicts),
            fate=fate,
            examples=tuple(
                example_of(project, campaign, record.id) for record in records[:MAX_EXAMPLES]
            ),
            sentence=violation_sentence(verdict),
            since=number,
            rules=JUDGED_SINCE,
            before=tuple(dict.fromkeys(signature_before(record.verdicts) for record in records)),
            failure_kind=kind_of(records[0].verdicts),
        )


def _is_sure(record: TrialRecord) -> bool:
    """Whether a failure always comes again, and most runs of its world and its copies fail."""
    again, copies = record.repeats, record.vote
    if again is not None and again.same.failures < again.same.trials:
        return False
    return copies is None or Vote(runs=1 + copies.runs, failed=1 + copies.failed).robust


def _finding_of(known: Finding, example: Example, row: Recheck, number: int) -> Finding | None:
    """Say what a stored failure is now; None: it could not be judged."""
    if row.fate in ("timeout", "not judged"):
        return None
    fails = row.fate == "still failing"
    vote = Vote(runs=1 + row.jittered, failed=int(fails) + row.jittered_failures)
    fate: Fate = "resolved" if not vote.failed else "flaky"
    if vote.robust:
        fate = "failing"
    reported = dataclasses.replace(
        known, fate=fate, examples=(example,), sentence=row.sentence or known.sentence, since=number
    )
    if not fails:
        return reported
    now, before = row.forms_now
    return dataclasses.replace(
        reported, signature=now, rules=JUDGED_SINCE, before=(before,), failure_kind=row.kind_now
    )
