"""Planted defects: how many simulations until a world tells them from the default stack?

    python -m benchmarks.defects.differing DIR [--budget 30] [--repeats 2] [--only NAME ...]
                                           [--sampler auto] [--engine kinematic] [--workers 1]

One campaign for each defect and repeat, on a program where the defect can matter, with the defect
under test and the default stack as the other one. Every specification is alike. A find counts as in
any campaign: the defect fails in most of four copies of the world, the default stack passes the
world and most of the same copies. Finished campaigns in DIR are not run again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import mrta_falsify as mf
from benchmarks.defects.worlds import PLANTS
from benchmarks.mutation.worlds import Source
from mrta_falsify.campaigns.store import SETTINGS
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.trial import campaign_specifications
from mrta_falsify.verbs.campaign_summary import CampaignSummary

#: small wards where the defect can matter; chosen by what it does
SCENARIOS = {
    "cluster_rows_wrong_robot": "three_walkers",
    "follower_zero_command": "narrow_pair",
    "humans_unseen_beyond_two": "three_walkers",
    "queue_release_loses_exclusion": "same_room",
    "room_freed_while_parked": "same_room",
    "fourth_waiter_dropped": "one_room",
    "same_room_twice_stalls": "same_room",
    "costmap_blind_to_furniture": "cluttered_corridor",
    "planner_failure_blocks_all": "closing_doors",
    "fixed_priority_starves": "radio_gaps_tight",
    "late_feedback_unsat": "late_batches",
    "no_plan_when_infeasible": "late_batches",
}
TIME_LIMIT = 3600.0  # s, of a trial on a machine that has other work
HEAD = f"{'defect':30} {'scenario':20} seed  found at  trials  other runs  on both  edges    s"


def search(defect: str, folder: Path, seed: int, args: argparse.Namespace) -> CampaignSummary:
    """Search for a world that tells a defect from the default stack."""
    directory = folder / f"{defect}-{seed}"
    if (directory / SETTINGS).exists():
        found = mf.resume_campaign(
            directory, budget=args.budget, stop_after=1, workers=args.workers
        )
    else:
        engine = Choice(args.engine)
        specifications = (*campaign_specifications(), PLANTS[defect].specification)
        found = mf.campaign(
            Source(scenario=SCENARIOS[defect]).place,
            directory,
            stack=StackConfig(engine=engine, defects=(defect,)),
            against="default",
            specs=tuple(dict.fromkeys(specifications)),
            budget=args.budget,
            stop_after=1,
            sampler=args.sampler,
            seed=seed,
            workers=args.workers,
            time_limit=TIME_LIMIT,
        )
    return mf.summarise_campaign(found)


def line(defect: str, seed: int, data: CampaignSummary) -> str:
    """Write a line of the table; a search that found nothing has no number."""
    against = data.against
    assert against is not None
    at = str(data.ran) if against.found else "-"
    return (
        f"{defect:30} {SCENARIOS[defect]:20} {seed:4}  {at:>8}  {data.ran:6}  {against.runs:10}  "
        f"{against.on_both:7}  {against.knife_edges:5}  {data.wall_s:5.0f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("directory", type=Path)
    parser.add_argument("--budget", type=int, default=30)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=list(SCENARIOS), choices=list(SCENARIOS))
    parser.add_argument("--sampler", default="auto")
    parser.add_argument("--engine", default="kinematic")
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    args.directory.mkdir(parents=True, exist_ok=True)
    print(HEAD, flush=True)
    found, spent = 0, 0
    for defect in args.only:
        for seed in range(args.repeats):
            data = search(defect, args.directory, seed, args)
            print(line(defect, seed, data), flush=True)
            found += data.against is not None and data.against.found > 0
            spent += data.ran
    searches = len(args.only) * args.repeats
    print(json.dumps({"searches": searches, "found": found, "simulations": spent}))


if __name__ == "__main__":
    main()
