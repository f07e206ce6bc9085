"""A machine that is busy: does a campaign find the same there, and is a trial lost?

    python -m experiments.campaign.busy_machine --budget 8 --busy 4

Runs two campaigns on the kinematic engine by the command line, each alone and beside processes
that do nothing but work: a shipped scenario, and a foreign stack as `init --stack
python` writes it. Limits are tight, so that one that counted wall-clock time would lose trials.
Records are compared but for the times that were measured.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

COMMAND = [sys.executable, "-m", "mrta_falsify.cli"]
#: the stack is started as `python3`, which is to be this one
ENVIRONMENT = {
    **os.environ,
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
}
MEASURED = ("wall_s", "scene_s")  # fields of a record, at any depth


@contextlib.contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep processors busy meanwhile."""
    burn = [sys.executable, "-S", "-c", "while True: pass"]
    started = [subprocess.Popen(burn) for _ in range(processes)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


def outcomes(directory: Path) -> dict[int, Any]:
    """What came of each trial, as the log of the campaign has it."""
    found: dict[int, Any] = {}
    log = directory / "records.jsonl"
    for line in log.read_text().splitlines() if log.exists() else ():
        record = record_of(line)
        found[record["candidate"]["number"]] = record
    return found


def record_of(line: str) -> Any:
    """Read the record of a line of the log, without what was measured."""
    return json.loads(line[line.index("{") : line.rindex("}") + 1], object_hook=_steady)


def _steady(data: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in data.items() if name not in MEASURED}


def campaign(directory: Path, options: Sequence[str]) -> tuple[int, float, int]:
    """Run a campaign; its exit code, how long it took [s], and how often it lost a trial."""
    began = time.monotonic()
    done = subprocess.run(
        [*COMMAND, "campaign", *options, "-o", str(directory), "--format", "json"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=ENVIRONMENT,
        check=False,
    )
    lost = sum("was lost" in line for line in done.stderr.splitlines())
    return done.returncode, round(time.monotonic() - began, 1), lost


def compared(folder: Path, name: str, options: list[str], processes: int) -> dict[str, Any]:
    """Run a campaign alone and beside busy processes, and compare."""
    alone, beside = folder / f"{name}-alone", folder / f"{name}-beside"
    code, wall, lost = campaign(alone, options)
    with busy(processes):
        busy_code, busy_wall, busy_lost = campaign(beside, options)
    one, other = outcomes(alone), outcomes(beside)

    def count(is_one: Callable[[Any], bool]) -> list[int]:
        return [sum(map(is_one, found.values())) for found in (one, other)]

    return {
        "campaign": name,
        "trials": [len(one), len(other)],
        "exit_codes": [code, busy_code],
        "wall_s": [wall, busy_wall],
        "errors": count(lambda record: record["status"] in ("crashed", "timeout")),
        "missing": len(one.keys() - other.keys()),
        "different": sum(other[n] != one[n] for n in one.keys() & other.keys()),
        "judged": count(lambda record: record["status"] == "ok"),
        "hangs": count(lambda record: "hang" in record.get("signature", "")),
        "lost_and_run_again": [lost, busy_lost],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--budget", type=int, default=8)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--busy", type=int, default=4, help="processes that work beside")
    parser.add_argument("--scenario", default="narrow_doors")
    parser.add_argument("--time-limit", type=float, default=12.0, help="s, of one trial")
    parser.add_argument("--tick-limit", type=float, default=0.05, help="s, of the foreign stack")
    parser.add_argument("--only", default="", choices=("", "shipped", "outside"))
    args = parser.parse_args()
    common = [
        "--budget", str(args.budget), "--workers", str(args.workers), "--sampler", "random",
        "--seed", "5", "--set", "engine=kinematic", "--time-limit", str(args.time_limit),
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        subprocess.run([*COMMAND, "init", place, "--stack", "python"], check=True, stdout=2)
        outside = [
            str(folder / "my_scenario.scenic"), "--stack", str(folder / "stack.yaml"),
            "-p", "horizon=60", "--verify", "1", *common,
            "--set", f"stack.tick_limit={args.tick_limit}",
        ]  # fmt: skip
        campaigns = {"shipped": [args.scenario, *common], "outside": outside}
        for name, options in campaigns.items():
            if args.only not in ("", name):
                continue
            print(json.dumps(compared(folder, name, options, args.busy)), flush=True)


if __name__ == "__main__":
    main()
