"""Which layer a failure belongs to: each is exchanged before the onset, then from the start."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from mrta_falsify.analysis.explain.case import Case
from mrta_falsify.analysis.explain.rows import (
    RUNS,
    curing,
    is_knife_edge,
    rows_of,
    suspicion_from,
)
from mrta_falsify.core.findings import Explanation, LayerRow
from mrta_falsify.core.run_result import Vote


class Layers:
    """A table of rows, each with one layer exchanged, and what they say."""

    least = 2 * RUNS

    def applies(self, case: Case) -> bool:
        """See :class:`.case.Question`."""
        del case
        return True  # without any change to try, the guess is told

    def ask(self, case: Case, found: Explanation, runs: int) -> Explanation:
        """See :class:`.case.Question`."""
        rows, untried = _rows(case, runs)
        reported = last_rows(rows)
        layer, reason = suspicion_from(reported, case.verdict, case.guess, untried)
        return dataclasses.replace(
            found,
            layer=layer,
            reason=reason,
            rows=rows,
            changed_at=reported[0].at if reported else case.at,
            jittered=_copies(reported),
        )


def last_rows(rows: Sequence[LayerRow]) -> tuple[LayerRow, ...]:
    """Give the rows that count: those that were exchanged at the last moment tried."""
    return tuple(row for row in rows if row.at == rows[-1].at)


def _rows(case: Case, runs: int) -> tuple[tuple[LayerRow, ...], tuple[str, ...]]:
    """Exchange layers shortly before the onset, and from the start where that says nothing.

    Returns:
        The rows, and the layers that no run was left for from the start; the guessed layer has
        its runs first.
    """
    job, failure, at, changes, lab = case.job, case.failure, case.at, case.changes, case.lab
    if not changes:
        return (), ()
    begun = lab.runs
    whole = RUNS * (1 + len(changes)) if at > 0.0 else 0
    rows = rows_of(job, failure, at, changes, runs, lab, reserve=whole)
    if not at or curing(rows) or is_knife_edge(rows[0]) or len(rows) == 1:
        return rows, ()
    # What was lost long before the onset is not mended by mending the layer that lost it.
    ranked = sorted(changes, key=lambda change: change.layer != case.guess)
    left = runs - (lab.runs - begun)
    room = max(0, left // RUNS - 1)
    if room:
        rows += rows_of(job, failure, 0.0, ranked[:room], left, lab)
    return rows, tuple(dict.fromkeys(change.layer for change in ranked[room:]))


def _copies(rows: Sequence[LayerRow]) -> Vote:
    """Count the copies of the stack as it is."""
    if not rows or rows[0].copies < 2:
        return Vote(runs=0, failed=0)
    stack = rows[0]
    return Vote(runs=stack.runs + stack.otherwise + stack.avoided, failed=stack.failed)
