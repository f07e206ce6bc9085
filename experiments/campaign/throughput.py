"""How much is simulated in an hour, and what is a second worker worth?

    python -m experiments.campaign.throughput --trials 100

Runs the same campaign with one worker and with several, in turns, and prints simulated hours per
hour of wall clock and parallel efficiency: wall time of one worker over (workers x wall time of
several). Both counts are of the same trials (a campaign does not depend on its workers), from
the first record to the last, so that compiling is apart. Needs an otherwise idle machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from experiments.campaign.ward_rounds import PROGRAM
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Store
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.commands.campaign import run_store
from mrta_falsify.commands.campaign_settings import new_settings


def one_run(
    scenario: str, engine: str, sampler: str, trials: int, workers: int, warm_up: int
) -> dict[str, Any]:
    """A campaign in a new directory, timed after its first ``warm_up`` records."""
    times: list[float] = []
    simulated: list[float] = []

    def on_record(record: TrialRecord, is_new: bool) -> None:
        assert is_new
        times.append(time.perf_counter())
        simulated.append(record.sim_time)

    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder) / "campaign"
        settings = new_settings(
            scenario,
            output=directory,
            stack=dataclasses.replace(StackConfig(), engine=Choice(engine)),
            sampler=sampler,
        )
        began = time.perf_counter()
        with Store.create(directory, settings) as store:
            result = run_store(
                store,
                Limits(budget=trials),
                Choice("processes", {"workers": workers, "recycle": 10**6}),
                on_record=on_record,
            )
    wall = times[-1] - times[warm_up - 1]
    computed = sum(r.wall_s + r.origin.scene_s for r in result.campaign.records)
    return {
        "workers": workers,
        "trials": len(times) - warm_up,
        "wall_s": round(wall, 2),
        "start_s": round(times[0] - began, 2),
        "simulated_h_per_h": round(sum(simulated[warm_up:]) / wall, 2),
        "trials_per_s": round((len(times) - warm_up) / wall, 3),
        "mean_trial_s": round(computed / len(times), 3),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default=str(PROGRAM))
    parser.add_argument("--engine", default="kinematic", choices=("kinematic", "bullet"))
    parser.add_argument("--sampler", default="random")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    warm_up = 2 * arguments.workers
    walls: dict[int, list[float]] = {1: [], arguments.workers: []}
    for _ in range(arguments.rounds):
        for workers, spent in walls.items():
            found = one_run(
                arguments.scenario,
                arguments.engine,
                arguments.sampler,
                arguments.trials + warm_up,
                workers,
                warm_up,
            )
            spent.append(found["wall_s"])
            print(json.dumps({"scenario": arguments.scenario, **found}), flush=True)
    alone, together = (statistics.median(walls[count]) for count in walls)
    summary = {
        "cores": len(os.sched_getaffinity(0)),
        "parallel_efficiency": round(alone / (arguments.workers * together), 3),
        "speed_up": round(alone / together, 3),
    }
    print(json.dumps(summary))


if __name__ == "__main__":
    main()
