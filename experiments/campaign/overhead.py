"""What a campaign costs beside its trials, with 10,000 results known.

    python -m experiments.campaign.overhead

CPU time of one ask and tell of every sampler in a cube of 200 coordinates, of decoding and
storing a record, of a trip to a worker process and back, and how long it takes to go on with a
campaign. Medians; the share is of one trial of ``ward_rounds.scenic``, measured in the same run.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.campaigns.executors import ProcessExecutor
from mrta_falsify.campaigns.runner import point_digest
from mrta_falsify.campaigns.store import Store, decode_record
from mrta_falsify.core import codec, registry
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import Choice
from mrta_falsify.core.feedback import Feedback
from mrta_falsify.core.protocols import Sampler
from mrta_falsify.core.record import Origin, SearchData, TrialRecord, versions
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.verdict import Verdict
from tests.campaigns.standin import settings

DIMENSIONS = 200
SPECIFICATIONS = ("no_deadlock", "deadlines", "all_tasks_done", "no_robot_robot_contact")
CUBE = {
    "dimensions": DIMENSIONS,
    "levels": [6 if i % 10 == 9 else 0 for i in range(DIMENSIONS)],
    "groups": [i // 4 for i in range(DIMENSIONS)],
}


def result(number: int, u: np.ndarray) -> Feedback:
    """A result that depends on some of the coordinates, failing now and then."""
    own = stream(number, "overhead")
    score = float(u[:12].mean()) - 0.25 + 0.05 * float(own.normal())
    margins = {name: score + 0.1 * i for i, name in enumerate(SPECIFICATIONS)}
    return Feedback(
        number=number,
        u=u,
        score=score,
        objectives=margins,
        descriptors={"x": float(u[0]), "y": float(u[1]), "robots": 0.4, "cause": 0.5},
        failed=score < 0.0,
        signature=f"no_deadlock/{number % 7}" if score < 0.0 else "",
    )


def ask_and_tell(sampler: Sampler, count: int) -> list[float]:
    """CPU time [s] of each ask with its tell."""
    spent = []
    for _ in range(count):
        began = time.process_time()
        proposal = sampler.ask()
        asked = time.process_time() - began
        feedback = result(proposal.number, proposal.u)
        began = time.process_time()
        sampler.tell(feedback)
        spent.append(asked + time.process_time() - began)
    return spent


def sampler_cost(name: str, known: int, measured: int) -> dict[str, Any]:
    """CPU time of a sampler that knows ``known`` results.

    It has asked for a thousand of them itself; the others came from elsewhere, which all
    samplers must bear.
    """
    sampler = registry.build("sampler", Choice(name, {"cube": CUBE, "seed": 1}))
    own = min(known, 1000)
    first = ask_and_tell(sampler, own)
    began = time.process_time()
    for number in range(own, known):
        sampler.tell(result(number, stream(number, "overhead/elsewhere").random(DIMENSIONS)))
    told = time.process_time() - began
    spent = ask_and_tell(sampler, measured)
    return {
        "sampler": name,
        "cpu_ms": round(1e3 * float(np.median(spent)), 3),
        "mean_cpu_ms": round(1e3 * float(np.mean(spent)), 3),
        "worst_cpu_ms": round(1e3 * max(spent), 2),
        "first_thousand_cpu_s": round(sum(first), 2),
        "told_from_elsewhere_cpu_s": round(told, 2),
    }


def record_of(number: int) -> TrialRecord:
    """A record as large as those of a hospital."""
    u = stream(number, "overhead/record").random(DIMENSIONS)
    verdicts = tuple(
        Verdict(spec=name, robustness=0.5, violated=False, evidence={"minimum_at": 12.5})
        for name in SPECIFICATIONS
    )
    result = RunResult(
        status="judged",
        verdicts=verdicts,
        margins=dict.fromkeys(SPECIFICATIONS, 0.5),
        trace="0" * 64,
        sim_time=120.0,
    )
    return TrialRecord(
        candidate=Candidate(number=number, u=u, seed=number),
        origin=Origin(proposal=point_digest(u), world="0" * 64, versions=versions()),
        result=result,
        search=SearchData(descriptors={"x": 0.1, "y": 0.2, "robots": 0.0, "cause": 0.0}),
    )


def store_cost(known: int, measured: int) -> dict[str, Any]:
    """CPU and wall time of decoding and storing one record, and of going on with all."""
    with tempfile.TemporaryDirectory() as folder:
        chosen = settings(dimensions=DIMENSIONS)
        with Store.create(Path(folder), chosen) as store:
            for number in range(known):
                store.add(record_of(number))
            cpu, wall = [], []
            for number in range(known, known + measured):
                data = codec.encode(record_of(number))
                began, began_wall = time.process_time(), time.perf_counter()
                store.add(decode_record(data, where="benchmark"))
                cpu.append(time.process_time() - began)
                wall.append(time.perf_counter() - began_wall)
        began = time.process_time()
        Store.resume(Path(folder)).close()
        reading = time.process_time() - began
    return {
        "store_cpu_ms": round(1e3 * float(np.median(cpu)), 3),
        "store_wall_ms": round(1e3 * float(np.median(wall)), 3),
        "reading_all_cpu_s": round(reading, 2),
    }


def trip_cost(measured: int) -> dict[str, Any]:
    """CPU time, in this process, of a trip to a worker process and back."""
    chosen = settings(dimensions=DIMENSIONS)
    executor = ProcessExecutor(ProcessExecutor.Options(workers=1, recycle=10**6))
    try:
        executor.open(chosen)
        spent = []
        for number in range(measured + 1):
            job = {"number": number, "u": [0.5] * DIMENSIONS}
            began = time.process_time()
            executor.submit(job)
            while not executor.collect(60.0):
                pass
            spent.append(time.process_time() - began)
    finally:
        executor.close()
    return {"trip_to_a_worker_cpu_ms": round(1e3 * float(np.median(spent[1:])), 2)}


def trial_cost(trials: int) -> float:
    """CPU time [s] of a trial, median."""
    from experiments.campaign.ward_rounds import ward_rounds  # noqa: PLC0415 - Scenic is slow
    from mrta_falsify.worker import open_trials as open_real  # noqa: PLC0415

    spent = []
    with tempfile.TemporaryDirectory() as folder:
        chosen = ward_rounds(Path(folder))
        run = open_real(chosen.trials)
        for number in range(trials + 1):
            u = stream(number, "overhead/trial").random(chosen.cube.dimensions)
            began = time.process_time()
            run({"number": number, "u": u.tolist()})
            spent.append(time.process_time() - began)
    return float(np.median(spent[1:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--known", type=int, default=10_000)
    parser.add_argument("--measured", type=int, default=60)
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--sampler", action="append", help="default: all that are registered")
    arguments = parser.parse_args()
    trial = trial_cost(arguments.trials)
    print(json.dumps({"trial_cpu_ms": round(1e3 * trial)}), flush=True)
    store = store_cost(arguments.known, arguments.measured) | trip_cost(arguments.measured)
    print(json.dumps(store), flush=True)
    for name in arguments.sampler or registry.names("sampler"):
        found = sampler_cost(name, arguments.known, arguments.measured)
        whole = found["cpu_ms"] + store["store_cpu_ms"] + store["trip_to_a_worker_cpu_ms"]
        found["with_store_and_trip_ms"] = round(whole, 2)
        found["share_of_a_trial"] = round(whole / (1e3 * trial), 4)
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
