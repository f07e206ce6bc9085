"""Judge labelled cases with the deadlock oracle, and compare its claims with the labels.

    python -m benchmarks.oracle.run labels.jsonl --workers 2 -o claims.jsonl

A run ends at the oracle's first claim, when all is delivered, or at the horizon. A claim that no
label bears out is examined again: do its members reach their next stops in continuations from its
moment? Rows are appended as they come; Ctrl-C loses the cases in progress only.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import sys
from pathlib import Path

from benchmarks.oracle.comparison import Comparison, compare
from benchmarks.oracle.continuing import Run
from benchmarks.oracle.figures import report
from benchmarks.oracle.labels import vote
from benchmarks.oracle.rows import Row, append_rows, cpu_seconds, read_rows
from benchmarks.oracle.worlds import Case, case_named
from mrta_falsify.specs.deadlock.oracle import NoDeadlock
from simulator_interface.episode import Episode
from simulator_interface.forecast import offer_forecasts

EVIDENCE = ("members", "victims", "root", "onset", "detected_at", "confirmed")


def claim_of(case: Case) -> Row | None:
    """Run a case until the oracle claims a deadlock.

    Returns:
        What it says of the first one; None: it claims none.
    """
    episode = Episode(case.world, case.config)
    oracle = NoDeadlock(NoDeadlock.Options())
    oracle.start(case.world, episode.dt)
    frames = episode.frames()
    offer_forecasts((oracle,), episode, frames)
    try:
        for frame in frames:
            oracle.update(frame)
            if oracle.verdict().violated or frame.sensed.time >= case.world.horizon:
                break
            if case.world.tasks and episode.all_done:
                break
    finally:
        frames.close()
    verdict = oracle.verdict()
    if not verdict.violated:
        return None
    return {key: verdict.evidence[key] for key in EVIDENCE if key in verdict.evidence}


def judged_row(name: str, labels: dict[str, Row]) -> Row:
    """Judge one case, and compare with its label.

    Args:
        name: of the case.
        labels: rows of labels by case.

    Raises:
        ValueError: the label is of another world or stack.
    """
    began = cpu_seconds()
    case, label = case_named(name), labels[name]
    if (label["world"], label["stack"]) != (case.world.digest(), case.config.digest()):
        raise ValueError(f"{name}: the label is of another world or stack; label it again")
    claim = claim_of(case)
    judged = cpu_seconds() - began
    found = compare(label, claim)
    again = claim is not None and (not found.is_hit or found.is_early)
    row = {"case": name, "kind": case.kind, **_plain(found), **(claim or {})}
    row["upheld"] = _upholds(case, claim) if claim and again else None
    return row | {"cpu_s": round(judged, 1)}


def _plain(found: Comparison) -> Row:
    """The comparison as a row: names without `is_`."""
    return {key.removeprefix("is_"): v for key, v in dataclasses.asdict(found).items()}


def _upholds(case: Case, claim: Row) -> bool:
    """Whether the claimed members are stuck in most continuations from the claim."""
    run = Run(case.world, case.config)
    try:
        run.advance(claim["detected_at"])
        stuck = vote(run).stuck
    finally:
        run.close()
    names = {robot.name: i for i, robot in enumerate(case.world.robots)}
    return {names[name] for name in claim["members"]} <= stuck


@functools.cache
def _labels(path: Path) -> dict[str, Row]:
    return read_rows(path)


def _judged(path: Path, name: str) -> Row:
    """Judge one case in a worker; it reads the labels once."""
    return judged_row(name, _labels(path))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("labels", type=Path, help="file of benchmarks.oracle.label")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("-o", "--output", type=Path, default=Path("oracle_claims.jsonl"))
    arguments = parser.parse_args()
    names = list(read_rows(arguments.labels))
    if not names:
        print(f"{arguments.labels}: has no labels", file=sys.stderr)
        return 2
    judge = functools.partial(_judged, arguments.labels)
    try:
        rows = append_rows(arguments.output, judge, names, arguments.workers)
    except KeyboardInterrupt:
        print("interrupted; the same call goes on with the rest", file=sys.stderr)
        return 130
    print(json.dumps(report(list(rows.values())), indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
