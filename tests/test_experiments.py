"""Every experiment still runs: for seconds, on the smallest input it takes.

Experiments are called as commands, and nothing of them is imported. Those that need data of others
(recorded walks, SMrTa's instances, floors of RMF) are left out.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "tests" / "recorded" / "campaigns" / "stalls"
STALLS = "same_room_twice_stalls"
CASE = {
    "name": "stalls",
    "kind": "visible",
    "family": STALLS,
    "seed": 1,
    "defects": [STALLS],
    "label": "waypoint_generator",
}  #: of experiments.causes

#: commands, those of one row in turn; ``TMP`` is their folder
COMMANDS = {
    "allocation": ["allocation.generate -o TMP/hard --count 1", "allocation.run cold"],
    "campaign overhead": ["campaign.overhead --known 200 --measured 3 --trials 1 --sampler random"],
    "campaign throughput": ["campaign.throughput --trials 4 --rounds 1"],
    "campaign unseen": ["campaign.unseen --campaigns 5"],
    "busy machine": ["campaign.busy_machine --budget 2 --busy 1 --only shipped"],
    "rare events": ["campaign.rare --campaigns 2 --p 0.01 --problem corner"],
    "causes": ["causes run TMP/cases.jsonl -o TMP/causes.jsonl --max-runs 2"],
    "controllers": ["control.bench"],
    "planted faults": ["defects.run --variants 1 --only same_room_twice_stalls --workers 1"],
    "foreign stack": ["door.ticks --robots 6 --rounds 1"],
    "engines agree": ["engine.agree --seconds 2 --rounds 1"],
    "engines tuned": ["engine.tune --seconds 0.5"],
    "search suite": [
        "falsification.suite rates TMP/suite --pairs lift_line --trials 2 --workers 1",
        "falsification.suite search TMP/suite --pairs lift_line --repeats 1 --budget 2 --workers 1",
        "falsification.suite table TMP/suite -o TMP/table",
    ],
    "long shift": ["long_shift --hours 0.01"],
    "oracle": [
        "oracle.label --rounds 1 --kinds corridor_swap,doorway -o TMP/labels.jsonl",
        "oracle.run TMP/labels.jsonl -o TMP/claims.jsonl",
    ],
    "oracle's cost": ["oracle.cost --repeats 1 --engines kinematic"],
    "people": ["people.flows --seeds 1 --densities 0.5 --widths 2.4"],
    "large fleets": ["planning.scale --seconds 1"],
    "minimal worlds": ["reports.minimising TMP/campaign -o TMP/minimal --max-cases 1 --max-runs 4"],
    "size of a report": ["reports.size --from tests/recorded/campaigns/beds --trials 20"],
    "scenic agreement": ["scenic.agreement --samples 2 --shipped 1"],
    "scenic costmap": ["scenic.costmap_agreement hot_room --worlds 1"],
    "scenic distribution": ["scenic.distribution hot_room --count 20"],
    "scenic specifiers": ["scenic.specifiers at --count 10"],
    "scenic speed": ["scenic.speed hot_room --count 2"],
    "engines judge": ["validity.engines table experiments/validity/rows.json"],
    "shut rooms": [
        "validity.shut_rooms run TMP/rows.jsonl --count 1 --called 2",
        "validity.shut_rooms table TMP/rows.jsonl",
    ],
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", COMMANDS)
def test_an_experiment_runs(name, tmp_path):
    shutil.copytree(CAMPAIGN, tmp_path / "campaign")
    (tmp_path / "cases.jsonl").write_text(json.dumps(CASE) + "\n")
    for command in COMMANDS[name]:
        module, *words = command.replace("TMP", str(tmp_path)).split()
        done = subprocess.run(
            [sys.executable, "-m", f"experiments.{module}", *words],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}: {done.stdout[-500:]}{done.stderr[-2000:]}"


@pytest.mark.long
def test_experiments_count_as_they_should():
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q", "experiments/tests"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
