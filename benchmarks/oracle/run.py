"""Precision, recall, delay and member exactness of the deadlock oracle on labelled runs.

    python -m benchmarks.oracle.run [--rounds 5] [--first 0] [--kinds a,b] [-o FILE.jsonl]

Each run is judged by the oracle; then it is labelled at the moment of its claim or, if the oracle
claims nothing, at the moment since which the robots that stand at its end have stood (a
missed deadlock would show there). Results are appended to FILE.jsonl as they come; cases
already in it are skipped, so the benchmark can be stopped and taken up again.
"""

from __future__ import annotations

import argparse
import collections
import concurrent.futures
import json
import multiprocessing
import time as clock
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.oracle.labels import EVERY, PLACE, Deadlock, label
from benchmarks.oracle.worlds import KINDS, SAMPLED, Case, cases
from mrta_falsify.core.fleet import Frame
from mrta_falsify.specs.deadlock.oracle import NoDeadlock
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.standstill import Standstill
from simulator_interface.episode import Episode
from simulator_interface.forecast import offer_forecasts

SUSPICIOUS = 8.0  # s of standing with a goal that make an unclaimed run worth a label
TOLERANCE = 1.0  # s after a claim; whoever gets 0.25 m nearer later than that refutes it


def judge(case: Case, *, thorough: bool = False) -> dict[str, Any]:
    """Run, claim and label of one case."""
    began = clock.process_time()
    claim, suspicion, ended = _run(case)
    row: dict[str, Any] = {"case": case.name, "kind": case.kind, "ended": ended}
    moment = claim["detected_at"] if claim else suspicion
    names = [robot.name for robot in case.world.robots]
    row["claimed"] = claim is not None
    row["moment"] = moment
    found: tuple[Deadlock, ...] = ()
    if moment is not None:
        truth = label(
            case.world, case.config, moment, standing_only=claim is None, thorough=thorough
        )
        found = truth.deadlocks
        row["continued_s"] = round(truth.continued, 1)
    row["deadlock"] = bool(found)
    row["true"] = [
        {"members": [names[i] for i in d.members], "group": [names[i] for i in d.group]}
        | {"onset": round(d.onset, 2), "settled": round(d.settled, 2), "stands": d.stands}
        for d in found
    ]
    if claim:
        row.update({key: claim[key] for key in ("members", "detected_at", "onset")})
        row["cycle"] = claim["cycle"]
        hits = [
            true
            for true in row["true"]
            if true["settled"] <= claim["detected_at"] + TOLERANCE
            and set(true["group"]) & set(claim["members"])
        ]
        row["hit"] = bool(hits)
        if hits:
            row["delay"] = max(0.0, claim["detected_at"] - max(true["onset"] for true in hits))
            row["exact"] = sorted(claim["members"]) in [sorted(t["members"]) for t in hits]
    row["cpu_s"] = round(clock.process_time() - began, 1)
    return row


def _run(case: Case) -> tuple[dict[str, Any] | None, float | None, str]:
    """The oracle's first claim, and since when robots that stand at the end have stood."""
    episode = Episode(case.world, case.config)
    oracle = NoDeadlock(NoDeadlock.Options())
    oracle.start(case.world, episode.dt)
    progress = ProgressClock(case.world)
    still = Standstill(len(case.world.robots), radius=PLACE)
    ended, frame, since = "horizon", None, np.zeros(0)
    frames = episode.frames()
    offer_forecasts((oracle,), episode, frames)
    for frame in frames:
        oracle.update(frame)
        since = still.update(frame.sensed.pose, frame.sensed.time)
        if frame.sensed.tick % EVERY:
            continue
        progress.update(frame)
        if oracle.verdict().violated:
            ended = "claimed"
            break
        if case.world.tasks and episode.all_done:
            ended = "all-tasks-done"
            break
        if frame.sensed.time >= case.world.horizon:
            break
    verdict = oracle.verdict()
    assert frame is not None
    claim = dict(verdict.evidence) if verdict.violated else None
    return claim, _suspicion(frame, np.maximum(since, progress.last)), ended


def _suspicion(frame: Frame, since: np.ndarray) -> float | None:
    has_goal = np.isfinite(frame.intent.goal[:, 0])
    standing = has_goal & (frame.sensed.time - since >= SUSPICIOUS)
    return float(since[standing].max()) if standing.any() else None


def report(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over all rows."""
    hit = [row for row in rows if row.get("hit")]
    false = [row for row in rows if row["claimed"] and not row["hit"]]
    missed = [row for row in rows if not row["claimed"] and row["deadlock"]]
    delays = np.array([row["delay"] for row in hit] or [np.nan])
    exact = [row for row in hit if row["exact"]]
    return {
        "traces": len(rows),
        "sampled": sum(row["kind"] in SAMPLED for row in rows),
        "deadlocks": len(hit) + len(missed),
        "kinds_with_deadlocks": len({row["kind"] for row in (*hit, *missed)}),
        "precision": round(len(hit) / max(1, len(hit) + len(false)), 3),
        "recall": round(len(hit) / max(1, len(hit) + len(missed)), 3),
        "delay_s": {
            "p50": round(float(np.median(delays)), 2),
            "p90": round(float(np.quantile(delays, 0.9)), 2),
            "within_5": round(float((delays <= 5.0).mean()), 3),
        },
        "members_exact": round(len(exact) / max(1, len(hit)), 3),
        "false": [row["case"] for row in false],
        "missed": [row["case"] for row in missed],
        "late": [row["case"] for row in hit if row["delay"] > 5.0],
        "inexact": [row["case"] for row in hit if not row["exact"]],
        "by_kind": {
            kind: f"{sum(r['deadlock'] for r in own)} of {len(own)}"
            for kind, own in _by_kind(rows).items()
        },
        "cpu_s": round(sum(row["cpu_s"] for row in rows), 1),
    }


def _by_kind(rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    groups: dict[str, list[dict[str, Any]]] = collections.defaultdict(list)
    for row in rows:
        groups[row["kind"]].append(row)
    return dict(sorted(groups.items()))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="40 cases each")
    parser.add_argument("--first", type=int, default=0, help="seed of the first case of a kind")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--thorough", action="store_true", help="simulate all 600 s of a label")
    parser.add_argument("-o", "--output", type=Path, default=Path("oracle_labels.jsonl"))
    arguments = parser.parse_args()
    rows: dict[str, dict[str, Any]] = {}
    if arguments.output.exists():
        for line in arguments.output.read_text().splitlines():
            row = json.loads(line)
            rows[row["case"]] = row
    kinds = tuple(arguments.kinds.split(","))
    chosen = list(cases(arguments.rounds, kinds, arguments.first))
    todo = [case for case in chosen if case.name not in rows]
    with arguments.output.open("a") as file:
        for row in _results(todo, arguments.workers, arguments.thorough):
            rows[row["case"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
    print(json.dumps(report([rows[case.name] for case in chosen]), indent=2))


def _results(todo: list[Case], workers: int, thorough: bool) -> Iterator[dict[str, Any]]:
    if workers <= 1:
        yield from (judge(case, thorough=thorough) for case in todo)
        return
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(workers, mp_context=context) as pool:
        jobs: Iterable[concurrent.futures.Future[dict[str, Any]]] = [
            pool.submit(judge, case, thorough=thorough) for case in todo
        ]
        for future in concurrent.futures.as_completed(jobs):
            yield future.result()


if __name__ == "__main__":
    main()
