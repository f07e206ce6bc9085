"""How good are failure families: how often does what they describe fail?

    python -m benchmarks.reports.families DIR [DIR ...] -o OUT [--max-cases N] [--max-runs 300]
                                          [--fresh 100] [--per-signature 1] [--part 1/2]
    python -m benchmarks.reports.families -o OUT --table

For the failed trials of any number of campaigns (DIR, or anywhere below it) the family is found
as by ``mrta-falsify family``, into OUT; the campaigns themselves are not touched. The precision
is measured on fresh samples of the written program. A row per case is kept in
OUT/families.jsonl; a second call goes on, also inside a case.
"""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import Any

from benchmarks.reports.stored_failures import (
    StoredFailure,
    cpu_seconds,
    run_study,
    study_options,
)
from mrta_falsify.core.errors import InputError
from mrta_falsify.verbs.family import find_family

STUDY = "families"


def study(case: StoredFailure, folder: Path, max_runs: int, fresh: int) -> dict[str, Any]:
    """Find the family of a failure; return its row, or why there is none.

    Args:
        case: the failure.
        folder: for the files.
        max_runs: simulations at most, those of the fresh samples included.
        fresh: samples on which the precision is measured.
    """
    began = cpu_seconds()
    try:
        apart = case.kept_apart(folder)
        found = find_family(apart, case.record, max_runs=max_runs, fresh=fresh)
    except InputError as error:
        return {**case.facts(), "error": str(error)}
    measured = found.precision
    fates = [condition.fate for condition in found.conditions]
    return {
        **case.facts(),
        "dimensions": len(found.conditions) + len(found.free),
        "free": len(found.free),
        "intervals": fates.count("interval"),
        "held": fates.count("held"),
        "not_tried": fates.count("unknown"),
        "noise_held": found.noise_seed is not None,
        "failures": measured.failures,
        "fresh": measured.trials,
        "low": round(measured.low, 4) if measured.trials else None,
        "high": round(measured.high, 4) if measured.trials else None,
        "no_scene": found.no_scene,
        "elsewhere": list(found.elsewhere),
        "simulations": found.learning_runs + measured.trials,
        "rule": list(found.rule),
        "cpu_s": round(cpu_seconds() - began, 1),
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Write the rows of the study as a Markdown table, with what they have in common."""
    done = [row for row in rows if "error" not in row]
    lines = [f"{len(rows)} failures"]
    lines += [f"no family: {row['case']}: {row['error']}" for row in rows if "error" in row]
    measured = [row for row in done if row["fresh"]]
    if measured:
        shares = [row["failures"] / row["fresh"] for row in measured]
        spent = statistics.median(row["simulations"] for row in measured)
        lines.append(
            f"precision: median {statistics.median(shares):.2f}, from {min(shares):.2f} to "
            f"{max(shares):.2f}; simulations: median {spent:g}"
        )
    lines += [
        "",
        "| Case | Stack | Signature | precision on fresh samples | in the campaign | dimensions "
        "that do not matter | in an interval | held | simulations | CPU time |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *map(_line, done)])


def _line(row: dict[str, Any]) -> str:
    precision = "no valid scene"
    if row["fresh"]:
        interval = f"{row['low']:.2f} to {row['high']:.2f}"
        precision = f"{row['failures']} of {row['fresh']} ({interval})"
    here, judged = row["elsewhere"]
    held = f"{row['held']} and {row['not_tried']} not tried" if row["not_tried"] else row["held"]
    cells = [
        f"{row['scenario']} {row['trial']}",
        ", ".join(row["defects"]) or "default",
        f"`{row['signature']}`",
        precision,
        f"{here} of {judged}",
        f"{row['free']} of {row['dimensions']}",
        row["intervals"],
        f"{held}, and the noise" if row["noise_held"] else held,
        row["simulations"],
        f"{row['cpu_s']:.0f} s",
    ]
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    """Run the command line."""
    parser = study_options(__doc__.splitlines()[0], max_runs=300, per_signature=1)
    parser.add_argument("--fresh", type=int, default=100)
    options = parser.parse_args()

    def row(case: StoredFailure, folder: Path) -> dict[str, Any]:
        return study(case, folder, max_runs=options.max_runs, fresh=options.fresh)

    run_study(STUDY, options, row, table)


if __name__ == "__main__":
    main()
