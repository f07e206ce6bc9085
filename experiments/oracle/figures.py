"""Figures over all compared runs, with exact bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from experiments.oracle.rows import Row
from experiments.oracle.worlds import COPIED, NOT_COPIED, SHIPPED

LEVEL = 0.95  # of one-sided bounds
IN_TIME = 5.0  # s from when the last member stands to the claim
EARLY = -1.0  # s; a claim earlier than this came before the last member stood


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
    """All figures, by group of stacks as well, then lists of what went wrong.

    Runs that cannot be copied are suspected at most, so they are told apart and are in no total.
    """
    judged = [row for row in rows if row["group"] != NOT_COPIED]
    right = [row for row in judged if row["right"]]
    return {
        "all": figures(judged),
        "without_borderline": figures([row for row in judged if not row["borderline"]]),
        **{
            group: figures([row for row in rows if row["group"] == group])
            for group in (SHIPPED, COPIED, NOT_COPIED)
        },
        "by_kind": {kind: _kind(rows, kind) for kind in dict.fromkeys(r["kind"] for r in rows)},
        "false": [r["case"] for r in judged if r["claimed"] and not r["right"]],
        "false_but_held": [r["case"] for r in judged if r["claimed"] and r["held"]],
        "missed": [r["case"] for r in judged if r["true"] and not r["right"]],
        "late": [r["case"] for r in right if r["delay"] is not None and r["delay"] > IN_TIME],
        "early": [r["case"] for r in right if r["delay"] is not None and r["delay"] < EARLY],
        "inexact": [r["case"] for r in right if not r["exact"]],
        "of_another_kind": [r["case"] for r in right if not r["kind_right"]],
        "contradicted": [r["case"] for r in judged if r["contradictions"]],
        "suspected_wrongly": [
            r["case"] for r in rows if r["group"] == NOT_COPIED and r["claimed"] and not r["right"]
        ],
    }


def figures(rows: Sequence[Row]) -> dict[str, Any]:
    """Precision, recall, delay, exactness and cost of some runs."""
    claimed = [row for row in rows if row["claimed"]]
    right = [row for row in claimed if row["right"]]
    true = [row for row in rows if row["true"]]
    delays = [row["delay"] for row in right if row["delay"] is not None]
    with_oracle = sum(row["cpu_s"] for row in rows)
    without = sum(row["cpu_without_s"] for row in rows)
    quantiles = [round(float(np.quantile(delays, q)), 2) for q in (0.5, 0.9)] if delays else None
    return {
        "runs": len(rows),
        "deadlocks": len(true),
        "precision": share(len(right), len(claimed)),
        "precision_3600": share(sum(row["right_3600"] for row in claimed), len(claimed)),
        "recall": share(len(right), len(true)),
        "members_exact": share(sum(row["exact"] for row in right), len(right)),
        "within_5_s": share(sum(delay <= IN_TIME for delay in delays), len(delays)),
        "within_5_s_and_not_before": share(
            sum(EARLY <= delay <= IN_TIME for delay in delays), len(delays)
        ),
        "kind_right": share(sum(row["kind_right"] for row in right), len(right)),
        "delay_p50_p90": quantiles,
        "cpu_s": round(with_oracle, 1),
        "cpu_without_s": round(without, 1),
    }


def _kind(rows: Sequence[Row], kind: str) -> str:
    own = [row for row in rows if row["kind"] == kind]
    true = sum(row["true"] for row in own)
    right = sum(row["right"] for row in own)
    false = sum(row["claimed"] and not row["right"] for row in own)
    doubtful = sum(row["borderline"] for row in own)
    exact = sum(row["exact"] for row in own if row["right"])
    return (
        f"{true} deadlocks of {len(own)}; {right} found, {false} false, "
        f"{exact} exact; {doubtful} borderline"
    )
