"""Precision, recall, delay and member exactness of the deadlock oracle on labelled runs.

    python -m benchmarks.oracle.run [--per-kind 15] [--kinds a,b] [--workers 2] [-o FILE.jsonl]

Each run is judged by the oracle; then it is labelled at the claimed onset or, if the oracle
claims nothing, at the moment from which some robot with a goal stood longest (a missed
deadlock would show there). Results are appended to FILE.jsonl as they come; cases already in
it are skipped, so the benchmark can be stopped and taken up again.
"""

from __future__ import annotations

import argparse
import collections
import concurrent.futures
import json
import multiprocessing
import time as wall_clock
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.oracle.labels import label
from benchmarks.oracle.worlds import KINDS, Case, cases
from mrta_falsify.core.fleet import Frame
from mrta_falsify.specs.deadlock import NoDeadlock
from mrta_falsify.specs.motion import Standstill
from simulator_interface.simulate import Episode

WATCH_AFTER = 40.0  # s that a run goes on after a claim: later claims are not judged
SUSPICIOUS = 8.0  # s of standing with a goal that make an unclaimed run worth a label


def judge(case: Case) -> dict[str, Any]:
    """Run, claim and label of one case."""
    began = wall_clock.perf_counter()
    claim, suspicion, ended = _run(case)
    row: dict[str, Any] = {"case": case.name, "kind": case.kind, "ended": ended}
    moment = claim["onset"] if claim else suspicion
    row["claimed"] = claim is not None
    row["moment"] = moment
    if claim:
        row.update({key: claim[key] for key in ("members", "detected_at", "onset", "hard")})
        row["cycle"] = claim["cycle"]
    if moment is None:
        row.update({"deadlock": False, "stuck": [], "true_members": []})
    else:
        truth = label(case.world, case.config, moment)
        names = [robot.name for robot in case.world.robots]
        row["deadlock"] = truth.is_deadlock
        row["stuck"] = [names[i] for i in truth.stuck]
        row["true_members"] = [[names[i] for i in members] for members in truth.deadlocks]
    row["wall_s"] = round(wall_clock.perf_counter() - began, 1)
    return row


def _run(case: Case) -> tuple[dict[str, Any] | None, float | None, str]:
    """The oracle's first claim, and the onset of the last long standstill at the end."""
    episode = Episode(case.world, case.config)
    oracle = NoDeadlock(NoDeadlock.Options())
    oracle.start(case.world, episode.dt)
    still = Standstill(len(case.world.robots), radius=0.3)
    claimed_at, ended, frame = None, "horizon", None
    for frame in episode.frames():
        oracle.update(frame)
        since = still.update(frame.sensed.pose, frame.sensed.time)
        if claimed_at is None and frame.sensed.tick % 20 == 0 and oracle.verdict().violated:
            claimed_at = frame.sensed.time
        if claimed_at is not None and frame.sensed.time > claimed_at + 1.0:
            ended = "claimed"
            break
        if frame.sensed.time >= case.world.horizon:
            break
        if case.world.tasks and episode.all_done:
            ended = "all-tasks-done"
            break
    verdict = oracle.verdict()
    claim = {**verdict.evidence} if verdict.violated else None
    assert frame is not None
    return claim, _suspicion(frame, since), ended


def _suspicion(frame: Frame, since: np.ndarray) -> float | None:
    has_goal = np.isfinite(frame.intent.goal[:, 0])
    standing = has_goal & (frame.sensed.time - since >= SUSPICIOUS)
    return float(since[standing].max()) if standing.any() else None


def report(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over all rows."""
    hit = [row for row in rows if row["claimed"] and row["deadlock"]]
    false = [row for row in rows if row["claimed"] and not row["deadlock"]]
    missed = [row for row in rows if not row["claimed"] and row["deadlock"]]
    delays = np.array([row["detected_at"] - row["onset"] for row in hit] or [np.nan])
    hard = np.array([r["detected_at"] - r["onset"] for r in hit if r["hard"]] or [np.nan])
    exact = [row for row in hit if sorted(row["members"]) in map(sorted, row["true_members"])]
    return {
        "traces": len(rows),
        "deadlocks": len(hit) + len(missed),
        "precision": len(hit) / max(1, len(hit) + len(false)),
        "recall": len(hit) / max(1, len(hit) + len(missed)),
        "delay_s": {
            "p50": float(np.median(delays)),
            "p95": float(np.quantile(delays, 0.95)),
            "within_5": float((delays <= 5.0).mean()),
            "hard_max": float(hard.max()),
        },
        "members_exact": len(exact) / max(1, len(hit)),
        "false": [row["case"] for row in false],
        "missed": [row["case"] for row in missed],
        "inexact": [row["case"] for row in hit if row not in exact],
        "by_kind": {
            kind: f"{sum(r['deadlock'] for r in own)} of {len(own)}"
            for kind, own in _by_kind(rows).items()
        },
    }


def _by_kind(rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    groups: dict[str, list[dict[str, Any]]] = collections.defaultdict(list)
    for row in rows:
        groups[row["kind"]].append(row)
    return dict(sorted(groups.items()))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--per-kind", type=int, default=15)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=Path("oracle_labels.jsonl"))
    arguments = parser.parse_args()
    rows: dict[str, dict[str, Any]] = {}
    if arguments.output.exists():
        for line in arguments.output.read_text().splitlines():
            row = json.loads(line)
            rows[row["case"]] = row
    kinds = tuple(arguments.kinds.split(","))
    todo = [case for case in cases(arguments.per_kind, kinds) if case.name not in rows]
    with arguments.output.open("a") as file:
        for row in _results(todo, arguments.workers):
            rows[row["case"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
    print(json.dumps(report([rows[name] for name in sorted(rows)]), indent=2))


def _results(todo: list[Case], workers: int):
    if workers <= 1:
        yield from map(judge, todo)
        return
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(workers, mp_context=context) as pool:
        for future in concurrent.futures.as_completed([pool.submit(judge, c) for c in todo]):
            yield future.result()


if __name__ == "__main__":
    main()
