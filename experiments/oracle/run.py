"""Judge labelled cases with the deadlock oracle, and compare its claims with the labels.

    python -m experiments.oracle.run labels.jsonl --workers 2 -o claims.jsonl

A run ends at the oracle's first claim, when all is delivered, or at the horizon. It is simulated
again without the oracle up to the same moment, for its CPU time. Rows are appended as they come;
Ctrl-C loses the cases in progress only.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import sys
from pathlib import Path
from typing import Any

from experiments.oracle.comparison import Comparison, compare
from experiments.oracle.figures import report
from experiments.oracle.rows import Row, cpu_seconds, read_rows, run_command
from experiments.oracle.stacks import identity
from experiments.oracle.worlds import NOT_COPIED, Case, case_named
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.library import build_specifications
from simulator_interface.simulate import simulate

ORACLE = "no_deadlock"
EVIDENCE = (
    *("members", "victims", "root", "onset", "detected_at", "confirmed"),
    *("stands_for", "for_good", "kind", "held_until_work", "contradictions"),
)


@dataclasses.dataclass
class Watched:
    """What the oracle says in the course of a run."""

    claim: Row | None = None  #: evidence of the first violated verdict
    verdict: Verdict | None = None  #: the last one
    suspects: tuple[str, ...] = ()  #: members of a suspicion that stands
    suspected_at: float | None = None  #: since when it stands [s]
    ended: float = 0.0  #: [s]


def watch(case: Case, *, after: float = 0.0) -> Watched:
    """Run a case until the oracle claims a deadlock.

    Args:
        case: to run.
        after: simulated after the first claim [s]; the claim is what the oracle says then.
    """
    (oracle,) = build_specifications([ORACLE])
    seen = Watched()
    claimed_at: list[float] = []

    def stop(frame: Frame) -> str:
        verdict, time = oracle.verdict(), frame.sensed.time
        is_suspected = verdict.outcome == "not_judged"
        members = tuple(verdict.evidence.get("members", ())) if is_suspected else ()
        if members != seen.suspects:
            seen.suspects, seen.suspected_at = members, time if members else None
        if verdict.violated and not claimed_at:
            claimed_at.append(time)
        return "claimed" if claimed_at and time >= claimed_at[0] + after - 1e-6 else ""

    outcome = simulate(
        case.world, case.config, specifications=[oracle], keep_trace=False, stop=stop
    )
    seen.verdict = next(v for v in outcome.verdicts if v.spec == ORACLE)
    seen.ended = outcome.sim_time
    if seen.verdict.violated:
        seen.claim = _evidence(seen.verdict)
    return seen


def _evidence(verdict: Verdict) -> Row:
    return {key: verdict.evidence[key] for key in EVIDENCE if key in verdict.evidence}


def _seconds_without(case: Case, until: float) -> float:
    """CPU time [s] of the same run without the oracle."""
    began = cpu_seconds()

    def stop(frame: Frame) -> str:
        return "time is up" if frame.sensed.time >= until - 1e-6 else ""

    simulate(case.world, case.config, specifications=[], keep_trace=False, stop=stop)
    return cpu_seconds() - began


def judged_row(name: str, labels: dict[str, Row], *, after: float = 0.0) -> Row:
    """Judge one case, and compare with its label.

    Args:
        name: of the case.
        labels: rows of labels by case.
        after: see :func:`watch`.

    Raises:
        ValueError: the label is of another world or stack.
    """
    case, label = case_named(name), labels[name]
    if (label["world"], label["stack"]) != (case.world.digest(), identity(case.config)):
        raise ValueError(f"{name}: the label is of another world or stack; label it again")
    began = cpu_seconds()
    seen = watch(case, after=after)
    judged = cpu_seconds() - began
    claim = seen.claim
    if case.group == NOT_COPIED and seen.suspected_at is not None:
        claim = {**_evidence(seen.verdict), "detected_at": seen.suspected_at}
    row: Row = {"case": name, "kind": case.kind, "group": case.group, "claim": claim}
    row |= _plain(compare(label, claim))
    row["contradictions"] = (seen.verdict.evidence or {}).get("contradictions")
    row["held_until_work"] = (seen.verdict.evidence or {}).get("held_until_work")
    row |= {"ended": round(seen.ended, 2), "cpu_s": round(judged, 2)}
    return row | {"cpu_without_s": round(_seconds_without(case, seen.ended), 2)}


def _plain(found: Comparison) -> Row:
    """The comparison as a row: names without `is_`."""
    return {key.removeprefix("is_"): v for key, v in dataclasses.asdict(found).items()}


@functools.cache
def _labels(path: Path) -> dict[str, Row]:
    return read_rows(path)


def _judged(path: Path, after: float, name: str) -> Row:
    """Judge one case in a worker; it reads the labels once."""
    return judged_row(name, _labels(path), after=after)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("labels", type=Path, help="file of experiments.oracle.label")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--most", type=int, help="judge so many cases at most, the first ones")
    parser.add_argument("--after", type=float, default=0.0, help="go on after a claim [s]")
    parser.add_argument("-o", "--output", type=Path, default=Path("oracle_claims.jsonl"))
    arguments = parser.parse_args()
    names: list[Any] = list(read_rows(arguments.labels))[: arguments.most]
    if not names:
        print(f"{arguments.labels}: has no labels", file=sys.stderr)
        return 2
    judge = functools.partial(_judged, arguments.labels, arguments.after)
    return run_command(arguments.output, judge, names, arguments.workers, report)


if __name__ == "__main__":
    sys.exit(main())
