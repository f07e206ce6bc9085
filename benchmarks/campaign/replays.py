"""Does a stored trial run again to the same trace, in another process, on another day?

    python -m benchmarks.campaign.replays --trials 500

Runs a campaign on ``ward_rounds.scenic`` with 2 worker processes (or takes one that is there), then
replays every stored trial in new processes, 3 of them, and compares trace digests and the
violations with their times.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.campaign.ward_rounds import ward_rounds
from mrta_falsify.campaigns.executors import ProcessExecutor
from mrta_falsify.campaigns.settings import Limits, TrialSettings
from mrta_falsify.campaigns.store import Store
from mrta_falsify.core.config import Choice
from mrta_falsify.verbs.campaign import run_store
from mrta_falsify.verbs.replay import replay_trial
from mrta_falsify.verbs.stored_trials import open_campaign


def open_replays(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """What a worker opens to replay stored trials instead of running new ones."""
    campaign = open_campaign(settings.directory)
    records = {record.number: record for record in campaign.records}

    def replay(job: dict[str, Any]) -> dict[str, Any]:
        again = replay_trial(campaign, records[job["number"]])
        return {"same_digest": again.same_digest == 1, "same_verdicts": again.same_verdicts == 1}

    return replay


def replay_all(directory: Path, workers: int) -> dict[str, Any]:
    """Replay all simulated trials of a campaign on ``workers`` processes."""
    campaign = open_campaign(directory)
    chosen = replace(campaign.settings, target="benchmarks.campaign.replays:open_replays")
    numbers = [record.number for record in campaign.records if record.status == "ok"]
    executor = ProcessExecutor(ProcessExecutor.Options(workers=workers))
    began = time.perf_counter()
    found: dict[int, dict[str, Any] | None] = {}
    try:
        executor.open(chosen)
        for number in numbers:
            executor.submit({"number": number})
        while len(found) < len(numbers):
            for done in executor.collect(60.0):
                found[done.number] = done.record
    finally:
        executor.close()
    answers = [answer or {} for answer in found.values()]
    return {
        "replayed": len(numbers),
        "equal_digests": sum(answer.get("same_digest", False) for answer in answers),
        "equal_verdicts": sum(answer.get("same_verdicts", False) for answer in answers),
        "distinct_digests": len({record.trace_digest for record in campaign.records}),
        "failed_trials": sum(record.failed for record in campaign.records),
        "workers": workers,
        "wall_s": round(time.perf_counter() - began, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--workers", type=int, default=3, help="of the replays; the campaign: 2")
    parser.add_argument("--campaign", type=Path, help="take this one instead of running one")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        directory = arguments.campaign or Path(folder)
        if arguments.campaign is None:
            with Store.create(directory, ward_rounds(directory)) as store:
                run_store(
                    store,
                    Limits(budget=arguments.trials),
                    Choice("processes", {"workers": 2, "recycle": 100}),
                )
        print(json.dumps(replay_all(directory, arguments.workers)))


if __name__ == "__main__":
    main()
