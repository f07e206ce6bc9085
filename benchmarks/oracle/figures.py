"""Figures over all compared runs, with exact bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.oracle.rows import Row

LEVEL = 0.95  # of one-sided bounds
IN_TIME = 5.0  # s from onset to claim


def lower_bound(successes: int, trials: int) -> float:
    """Lower one-sided 95 % bound of a share (Clopper and Pearson 1934); 0 without trials."""
    if successes == 0:
        return 0.0
    return float(stats.beta.ppf(1.0 - LEVEL, successes, trials - successes + 1))


def share(successes: int, trials: int) -> dict[str, Any]:
    """A share as numbers, with its lower bound."""
    return {
        "share": round(successes / trials, 4) if trials else None,
        "of": f"{successes} of {trials}",
        "lower_95": round(lower_bound(successes, trials), 4),
    }


def report(rows: Sequence[Row]) -> dict[str, Any]:
    """All figures: with borderline runs and without, then lists of what went wrong."""
    clear = [row for row in rows if not row["borderline"]]
    hits = [row for row in rows if row["hit"]]
    return {
        "all": figures(rows),
        "without_borderline": figures(clear),
        "by_kind": {kind: _kind(rows, kind) for kind in dict.fromkeys(r["kind"] for r in rows)},
        "false": [r["case"] for r in rows if r["claimed"] and not _is_right(r)],
        "false_but_upheld": [r["case"] for r in rows if r["claimed"] and _is_upheld(r)],
        "missed": [r["case"] for r in rows if _is_missed(r)],
        "late": [r["case"] for r in hits if r["delay"] is not None and r["delay"] > IN_TIME],
        "inexact": [r["case"] for r in hits if not r["exact"]],
        "cpu_s": round(sum(row["cpu_s"] for row in rows), 1),
    }


def figures(rows: Sequence[Row]) -> dict[str, Any]:
    """Precision, recall, delay and exactness of some runs."""
    claimed = [row for row in rows if row["claimed"]]
    right = [row for row in claimed if _is_right(row)]
    true = [row for row in rows if row["true"]]
    timed = [row for row in right if row["delay"] is not None]
    delays = np.array([row["delay"] for row in timed] or [np.nan])
    sealed = [row for row in timed if _within(row["delay_sealed"])]
    upheld = sum(_is_right(row) or _is_upheld(row) for row in claimed)
    return {
        "runs": len(rows),
        "deadlocks": len(true),
        "precision": share(len(right), len(claimed)),
        "precision_upheld": share(upheld, len(claimed)),
        "recall": share(sum(row in right for row in true), len(true)),
        "within_5_s": share(sum(_within(row["delay"]) for row in timed), len(timed)),
        "within_5_s_of_sealed": share(len(sealed), len(timed)),
        "delay_p50_p90": [round(float(np.quantile(delays, q)), 2) for q in (0.5, 0.9)],
        "members_exact": share(sum(row["exact"] for row in right), len(right)),
    }


def _is_right(row: Row) -> bool:
    """Whether the claim names a deadlock of the label, and not before it is one."""
    return bool(row["hit"]) and (not row["early"] or bool(row["upheld"]))


def _is_upheld(row: Row) -> bool:
    """Whether continuations from the claim uphold it, though the label knows no such deadlock."""
    return not _is_right(row) and bool(row["upheld"])


def _is_missed(row: Row) -> bool:
    return bool(row["true"]) and not (row["claimed"] and _is_right(row))


def _within(delay: float | None) -> bool:
    return delay is not None and delay <= IN_TIME


def _kind(rows: Sequence[Row], kind: str) -> str:
    own = [row for row in rows if row["kind"] == kind]
    true = sum(row["true"] for row in own)
    right = sum(row["claimed"] and _is_right(row) for row in own)
    false = sum(row["claimed"] and not _is_right(row) for row in own)
    doubtful = sum(row["borderline"] for row in own)
    exact = sum(row["exact"] for row in own if row["claimed"] and _is_right(row))
    return (
        f"{true} deadlocks of {len(own)}; {right} found, {false} false, "
        f"{exact} exact; {doubtful} borderline"
    )
