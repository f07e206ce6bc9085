"""Draw failures, explain them, and count how often the layer is right.

    python -m experiments.causes draw cases.jsonl --seed 46000 --each 3
    python -m experiments.causes run cases.jsonl -o rows.jsonl [--max-runs 120]

All failures of a draw count. They are explained in an order that the seed draws, so that those done
so far are a sample of all. ``explain`` and the guess from the trace are told apart.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import random
import sys
from collections.abc import Collection
from pathlib import Path

from experiments.causes.cases import Case, draw, faulty
from experiments.oracle.rows import Row, cpu_seconds, run_command
from mrta_falsify.core import codec
from mrta_falsify.specs.attribution import WORLD
from mrta_falsify.analysis.explain.explaining import explain_job


def explained(cases: dict[str, Case], max_runs: int, name: str) -> Row:
    """Explain one failure."""
    case, began = cases[name], cpu_seconds()
    with faulty(case):
        found = explain_job(case.job(), max_runs=max_runs)
    return {
        "case": name,
        "kind": case.kind,
        "label": case.label,
        "layer": found.layer,
        "guess": found.guess,
        "reason": found.reason,
        "rows": [[row.change, row.failed, row.runs, row.beside] for row in found.rows],
        "runs": found.runs,
        "cpu_s": round(cpu_seconds() - began, 1),
    }


def report(rows: Collection[Row]) -> Row:
    """Count right, none and wrong by kind, for the rows and for the guess from the trace."""
    told: Row = {}
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        told[kind] = {who: _counts(own, who) for who in ("layer", "guess")}
        told[kind]["failures"] = len(own)
        told[kind]["CPU s a failure"] = round(sum(row["cpu_s"] for row in own) / len(own), 1)
        told[kind]["runs a failure"] = round(sum(row["runs"] for row in own) / len(own), 1)
    return told


def _counts(rows: Collection[Row], who: str) -> Row:
    named = [(row["label"], "" if row[who] == WORLD else row[who]) for row in rows]
    return {
        "right": sum(label == name for label, name in named),
        "none": sum(bool(label) and not name for label, name in named),
        "wrong": sum(bool(name) and label != name for label, name in named),
    }


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("draw", "run"))
    parser.add_argument("cases", type=Path)
    parser.add_argument("--seed", type=int, default=46000, help="of the draw and of the order")
    parser.add_argument("--each", type=int, default=3)
    parser.add_argument("--max-runs", type=int, default=120)
    parser.add_argument("--workers", type=int, default=1, help="failures at a time")
    parser.add_argument("-o", "--output", type=Path, default=Path("causes.jsonl"))
    arguments = parser.parse_args()
    if arguments.what == "draw":
        with arguments.cases.open("w") as file:
            for case in draw(arguments.seed, arguments.each):
                file.write(json.dumps(dataclasses.asdict(case)) + "\n")
                file.flush()
        return 0
    lines = arguments.cases.read_text().splitlines()
    cases = {c.name: c for c in (codec.decode(Case, json.loads(line)) for line in lines)}
    names = list(cases)
    random.Random(arguments.seed).shuffle(names)
    make = functools.partial(explained, cases, arguments.max_runs)
    return run_command(arguments.output, make, names, arguments.workers, report)


if __name__ == "__main__":
    sys.exit(main())
