"""Label cases for the benchmark of the deadlock oracle; the oracle takes no part in it.

    python -m experiments.oracle.label --first 10000 --rounds 8 --workers 2 -o labels.jsonl

Rows are appended as they come. Ctrl-C loses the cases in progress only; a second call goes on.
"""

from __future__ import annotations

import argparse
import functools
import sys
from pathlib import Path

from experiments.oracle.labels import Deadlock, label
from experiments.oracle.rows import Row, cpu_seconds, run_command
from experiments.oracle.stacks import identity
from experiments.oracle.worlds import KINDS, ROUND, case_named, cases


def label_row(name: str, *, thorough: bool = False) -> Row:
    """Label one case.

    Args:
        name: kind and seed, as ``niches/10003``.
        thorough: see :func:`experiments.oracle.labels.label`.
    """
    began = cpu_seconds()
    made = case_named(name)
    truth = label(made.world, made.config, thorough=thorough)
    robots = [robot.name for robot in made.world.robots]
    return {
        "case": name,
        "kind": made.kind,
        "group": made.group,
        "world": made.world.digest(),
        "stack": identity(made.config),
        "horizon": made.world.horizon,
        "ended": round(truth.ended, 2),
        "deadlocks": [_deadlock_row(found, robots) for found in truth.deadlocks],
        "ways": dict(zip(robots, truth.ways, strict=True)),
        "held": [
            {"robot": robots[held.robot], "moment": held.moment, "until": held.until}
            for held in truth.held
        ],
        "borderline": truth.is_borderline,
        "continued_s": round(truth.continued, 1),
        "cpu_s": round(cpu_seconds() - began, 1),
    }


def _deadlock_row(found: Deadlock, robots: list[str]) -> Row:
    return {
        "members": [robots[i] for i in found.members],
        "victims": [robots[i] for i in found.victims],
        "kind": found.kind,
        "stands": round(found.stands, 2),
        "there": round(found.there, 2),
        "moving": found.is_moving,
        "borderline": found.is_borderline,
    }


def positives(rows: list[Row]) -> dict[str, str]:
    """Cases with a deadlock of all cases, borderline ones, and seconds of CPU, by kind."""
    table = {}
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        found = [row for row in own if row["deadlocks"]]
        doubtful = sum(
            row["borderline"] or any(d["borderline"] for d in row["deadlocks"]) for row in own
        )
        cpu = sum(row["cpu_s"] for row in own) / len(own)
        table[kind] = f"{len(found)} of {len(own)}, {doubtful} borderline, {cpu:.1f} s a case"
    return table


def add_case_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose cases."""
    parser.add_argument("--rounds", type=int, default=8, help="how often the kinds come in turn")
    parser.add_argument("--first", type=int, default=0, help="seed of the first case of a kind")
    parser.add_argument("--kinds", default=",".join(ROUND), help="which, separated by commas")
    parser.add_argument("--workers", type=int, default=1, help="processes")


def chosen_cases(arguments: argparse.Namespace) -> list[str]:
    """Names of the cases that the options choose."""
    kinds = tuple(arguments.kinds.split(","))
    unknown = sorted(set(kinds) - set(KINDS))
    if unknown:
        raise SystemExit(f"--kinds: there is no {unknown[0]}; known: {', '.join(KINDS)}")
    return list(cases(arguments.rounds, kinds, arguments.first))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_case_options(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("oracle_labels.jsonl"))
    parser.add_argument("--thorough", action="store_true", help="simulate all 3,600 s")
    arguments = parser.parse_args()
    make = functools.partial(label_row, thorough=arguments.thorough)
    names = chosen_cases(arguments)
    return run_command(arguments.output, make, names, arguments.workers, _summary)


def _summary(made: list[Row]) -> Row:
    return {
        "cases": len(made),
        "with_deadlocks": sum(bool(row["deadlocks"]) for row in made),
        "cpu_s": round(sum(row["cpu_s"] for row in made)),
        "by_kind": positives(made),
    }


if __name__ == "__main__":
    sys.exit(main())
