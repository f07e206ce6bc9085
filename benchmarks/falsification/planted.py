"""Planted defects: how many simulations until a campaign finds each, and is the layer named right?

    python -m benchmarks.falsification.planted DIR [--budget 150] [--seed 0] [--only NAME ...]

For each defect one campaign with ``auto`` on the kinematic engine runs on the scenario that
stresses what the defect breaks (``PAIRS``), failure by failure, until one is the defect's doing for
certain: the stack with the defect fails in at least 3 of 4 copies of the world with small
differences, and the stack without it in at most 1 (``benchmarks.copies``). ``explain`` then says
which layer it suspects. The other failures on the way are the default stack's own, or stand on a
knife edge, and are counted.

Campaigns are kept in DIR and results appended to DIR/planted.jsonl; a second call goes on.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time as clock
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.copies import Told, told_apart
from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import DEFECTS
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World
from mrta_falsify.trial import Job, campaign_specifications, judge
from mrta_falsify.verbs.campaign import open_store, run_store
from mrta_falsify.verbs.campaign_settings import new_settings
from mrta_falsify.verbs.explain import explain
from mrta_falsify.verbs.stored_trials import stored_world
from mrta_falsify.verbs.workers import local_workers

OF_SUITE = Path(__file__).parent / "scenarios"

#: defect -> scenario, shipped or of the suite, that stresses what it breaks
PAIRS: dict[str, str] = {
    "cluster_rows_wrong_robot": "opposing_flows",
    "follower_zero_command": "opposing_flows",
    "queue_release_loses_exclusion": "hot_room",
    "room_freed_while_parked": "hot_room",
    "same_room_twice_stalls": "burst_of_tasks",
    "costmap_blind_to_furniture": "bookshelf",
    "humans_unseen_beyond_two": "rush_of_visitors",
    "planner_failure_blocks_all": "blockage_mid_run",
    "fourth_waiter_dropped": "hot_room",
    "fixed_priority_starves": str(OF_SUITE / "narrow_pair.scenic"),
    "late_feedback_unsat": str(OF_SUITE / "late_batches.scenic"),
    "no_plan_when_infeasible": str(OF_SUITE / "hopeless_deadline.scenic"),
}
#: where the sound stack violates the others, too: nobody can meet a hopeless deadline
SPECIFICATIONS: dict[str, tuple[str, ...]] = {"no_plan_when_infeasible": ("all_tasks_done",)}


def find(defect: str, directory: Path, *, budget: int, seed: int, workers: int) -> dict[str, Any]:
    """One row: simulations until the defect showed, and the layer that was named."""
    began = clock.monotonic()
    config = StackConfig(engine=Choice("kinematic"), defects=(defect,))
    specifications = SPECIFICATIONS.get(defect, campaign_specifications())
    settings = new_settings(
        PAIRS[defect],
        output=directory,
        stack=config,
        specs=specifications,
        sampler="auto",
        seed=seed,
    )
    name = Path(PAIRS[defect]).stem
    row: dict[str, Any] = {"defect": defect, "scenario": name, "budget": budget}
    row |= {"found_at": None, "own_failures": 0}
    judged: set[int] = set()
    while row["found_at"] is None:
        limits = Limits(budget=budget, stop_after=len(judged) + 1)
        with open_store(directory, settings) as store:
            result = run_store(store, limits, local_workers(workers))
        if result.ended == "interrupted":
            raise KeyboardInterrupt
        new = [r for r in result.campaign.records if r.failed and r.number not in judged]
        for record in new:
            judged.add(record.number)
            told = _told(result.campaign, record, config, specifications)
            if told.apart:
                row["copies"] = str(told)
                named = explain(result.campaign, record, max_runs=16)
                row["found_at"] = record.number + 1
                row["violated"] = [v.spec for v in record.verdicts if v.violated]
                row |= {"layer": DEFECTS[defect].layer, "named": named.layer, "guess": named.guess}
                break
            row["own_failures"] += 1
        row["ran"] = result.progress.ran
        if result.ended != "stop-after":
            break
    row["wall_s"] = round(clock.monotonic() - began, 1)
    return row


def _told(
    campaign: Campaign, record: TrialRecord, config: StackConfig, specifications: tuple[str, ...]
) -> Told:
    """Ask copies of a failing world whether the failure is the defect's doing."""

    def fails(stack: StackConfig, world: World) -> bool:
        job = Job(world=world, config=stack, specifications=specifications, early_stop=True)
        return judge(job, keep_trace=False).failed

    return told_apart(
        stored_world(campaign, record),
        changed=partial(fails, config),
        sound=partial(fails, dataclasses.replace(config, defects=())),
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=Path)
    parser.add_argument("--budget", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=list(PAIRS))
    arguments = parser.parse_args()
    arguments.directory.mkdir(parents=True, exist_ok=True)
    path = arguments.directory / "planted.jsonl"
    rows = list(read_rows(path))
    for defect in arguments.only:
        if any(row["defect"] == defect for row in rows):
            continue
        row = find(
            defect,
            arguments.directory / defect,
            budget=arguments.budget,
            seed=arguments.seed,
            workers=arguments.workers,
        )
        rows.append(row)
        append_row(path, row)
        print(json.dumps(row), flush=True)
    found = [row for row in rows if row["found_at"]]
    named = sum(row["named"] == row["layer"] for row in found)
    print(f"{len(found)} of {len(rows)} found, layer named right for {named}")


if __name__ == "__main__":
    main()
