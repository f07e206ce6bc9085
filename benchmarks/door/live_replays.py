"""Does a foreign stack that is asked again give the same run, a thousand times?

    python -m benchmarks.door.live_replays --replays 1000

Runs a campaign of short trials with the stack that `init --stack cpp` writes, and replays its
trials live, in this process (a thousand starts of the command line would measure those). Then the
same with a stack whose threads race; the first tick that differs is named.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import mrta_falsify as mf

ROOT = Path(__file__).resolve().parents[2]
STARTER = ROOT / "mrta_falsify" / "verbs" / "starter"
CLIENTS = ROOT / "simulator_interface" / "clients"
TRIALS = 8
ROUND = 10  # replays between two lines of progress
RACES = 10  # replays of the stack whose threads race
PROGRAM = """
model scenic_worlds.model
new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 1
new Trolley in corridors
param tasks = [(0, 0, DiscreteRange(2, 5), Range(200, 300))]
param horizon = 10
"""


def cpp_stack(folder: Path) -> dict[str, Any]:
    compiler = shutil.which("c++")
    if compiler is None:
        sys.exit("there is no C++ compiler")
    program = str(folder / "my_stack")
    source = str(STARTER / "cpp" / "my_stack.cpp")
    subprocess.run(
        [compiler, "-std=c++17", "-O2", f"-I{CLIENTS}", "-o", program, source], check=True
    )
    return {"command": [program]}


def racing_stack() -> dict[str, Any]:
    return {
        "command": [sys.executable, "-m", "tests.external.racing_stack"],
        "folder": str(ROOT),
        "env": {"PYTHONPATH": str(ROOT)},
    }


def replayed(folder: Path, name: str, stack: dict[str, Any], replays: int) -> dict[str, Any]:
    """Run a campaign, and replay its trials live."""
    (folder / "short.scenic").write_text(PROGRAM)
    config = folder / f"{name}.yaml"
    config.write_text(json.dumps({"engine": "kinematic", "stack": stack}))  # JSON is YAML
    runs = folder / name
    mf.campaign(
        str(folder / "short.scenic"), stack=str(config), output=str(runs), budget=TRIALS, workers=1,
        sampler="random",
    )  # fmt: skip
    began, done, equal, differences = time.monotonic(), 0, 0, []
    while done < replays:
        count = min(ROUND, replays - done)
        found = mf.replay(str(runs), done // ROUND % TRIALS, verify=count, live=True)
        done, equal = done + count, equal + found.same_digest
        if found.difference is not None:
            differences.append(str(found.difference))
        left = (time.monotonic() - began) / done * (replays - done)
        print(f"{name}: {done} of {replays}, {left:.0f} s left", file=sys.stderr, flush=True)
    wall = round(time.monotonic() - began, 1)
    return {"replays": done, "equal": equal, "wall_s": wall, "differences": differences[:3]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replays", type=int, default=1000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        same = replayed(folder, "deterministic", cpp_stack(folder), arguments.replays)
        raced = replayed(folder, "racing", racing_stack(), min(RACES, arguments.replays))
    print(json.dumps({"deterministic": same, "racing": raced}, indent=1))
    sys.exit(same["equal"] != same["replays"] or not raced["differences"])


if __name__ == "__main__":
    main()
