"""What copies of failing worlds cost, with and without copies that vote on each of them.

    python -m benchmarks.campaign.voting_copies DIR [DIR ...]

DIR is a campaign that ran copies (``--jittered``). The copies of each failure run again, in turn as
a run of their own is judged (``voting``) and as copies are (``alone``). Told are how many of them
fail, and seconds of CPU.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.oracle.rows import cpu_seconds
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.copies import run_copies
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.trial import Job, judge, of_copy
from mrta_falsify.verbs.stored_trials import open_campaign, stored_world
from mrta_falsify.worker import trial_job
from scenic_worlds.variation import jittered_worlds

KINDS: dict[str, Callable[[Job], Job]] = {"voting": lambda job: job, "alone": of_copy}


def measured(campaign: Campaign, record: TrialRecord) -> dict[str, Any]:
    """Run the copies of a failure in both ways."""
    trials = campaign.settings.trials
    copies = jittered_worlds(stored_world(campaign, record), trials.jittered)
    row: dict[str, Any] = {"trial": record.id, "signature": record.signature}
    for name, kind in KINDS.items():
        began = cpu_seconds()
        runs = run_copies(
            copies,
            lambda copy, kind=kind: judge(
                kind(trial_job(trials, copy, trials.stack)), keep_trace=False
            ),
            lambda run: run.is_sought,
        )
        row[name] = f"{sum(run.is_sought for run in runs)} of {len(runs)}"
        row[f"{name}_cpu_s"] = round(cpu_seconds() - began, 1)
    return row


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directories", type=Path, nargs="+")
    rows = []
    for directory in parser.parse_args().directories:
        campaign = open_campaign(directory)
        for record in campaign.records:
            if record.jittered is not None:
                rows.append(measured(campaign, record))
                print(json.dumps({"of": str(directory), **rows[-1]}), flush=True)
    total = {f"{name}_cpu_s": round(sum(row[f"{name}_cpu_s"] for row in rows), 1) for name in KINDS}
    same = sum(row["voting"] == row["alone"] for row in rows)
    print(json.dumps({"failures": len(rows), "same_count": same, **total}))


if __name__ == "__main__":
    main()
