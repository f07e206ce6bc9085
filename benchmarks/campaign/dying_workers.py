"""Machines that die and come back: is a trial lost, doubled, or different afterwards?

    python -m benchmarks.campaign.dying_workers --workers 8 --trials 120

Starts a Dask scheduler and workers on the loopback; each worker stands for a machine.
While a campaign runs on them, one after another is killed with -9, its trial with it, and started
again. Afterwards the log is compared with that of the same campaign in local processes.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.campaign.ward_rounds import PROGRAM
from mrta_falsify.campaigns.store import read_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.seeding import stream

LOOPBACK = "127.0.0.1"
ENDS_WITHIN = 2.0  # s that processes have to notice that their worker is gone
COMMAND = [sys.executable, "-m", "mrta_falsify.cli"]
#: fields of a record that say where and how fast a trial ran, not what came of it
OF_THE_MACHINE = ("wall_s", "scene_s", "versions")


def free_port() -> int:
    """Find a port that nobody uses."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def in_group(group: int) -> int:
    """Count the processes of a process group that run."""
    found = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of_group = stat.read_text().rpartition(")")[2].split()[:3]
        except OSError:
            continue
        found += int(of_group) == group and state != "Z"
    return found


class Machines:
    """A scheduler and workers that can be killed.

    Args:
        count: workers.
        folder: for their logs.
    """

    def __init__(self, count: int, folder: Path) -> None:
        self._folder = folder
        self.address = f"tcp://{LOOPBACK}:{free_port()}"
        port = self.address.rpartition(":")[2]
        self._scheduler = self._start(
            "scheduler", "--host", LOOPBACK, "--port", port, "--no-dashboard"
        )
        self._workers = [self._worker(k) for k in range(count)]
        self.killed = 0
        self.left_running = 0  #: processes that outlived their worker

    def kill_one(self, k: int) -> None:
        """Kill a worker, see whether what it had started ends with it, and start it again."""
        worker = self._workers[k]
        worker.kill()
        worker.wait()
        time.sleep(ENDS_WITHIN)
        self.left_running += in_group(worker.pid)
        self._workers[k] = self._worker(k)
        self.killed += 1

    def close(self) -> None:
        """End all."""
        for process in (*self._workers, self._scheduler):
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def _worker(self, k: int) -> subprocess.Popen[bytes]:
        return self._start(
            "worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard",
            "--name", f"machine{k}", "--host", LOOPBACK, "--memory-limit", "0",
        )  # fmt: skip

    def _start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        log = (self._folder / f"{kind}.log").open("ab")
        return subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + kind, *options],
            stdout=log,
            stderr=log,
            start_new_session=True,
            cwd=self._folder,
        )


def campaign(directory: Path, trials: int, *options: str, **env: str) -> subprocess.Popen[str]:
    """Start a campaign of the benchmarks' scenario."""
    common = ["--budget", str(trials), "--sampler", "random", "--seed", "5", "--jittered", "0"]
    return subprocess.Popen(
        [*COMMAND, "campaign", str(PROGRAM), "-o", str(directory), *common,
         "--set", "engine=kinematic", "--format", "json", *options],
        env={**os.environ, **env},
        stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def outcomes(directory: Path) -> dict[int, list[str]]:
    """What came of each trial, as often as it is in the log."""
    found: dict[int, list[str]] = {}
    for record in read_campaign(directory).records:
        found.setdefault(record.number, []).append(_told(record))
    return found


def _told(record: TrialRecord) -> str:
    fields = codec.encode(record)
    kept = {name: value for name, value in fields.items() if name not in OF_THE_MACHINE}
    return json.dumps(kept, sort_keys=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=8)
    parser.add_argument("--trials", type=int, default=120)
    parser.add_argument("--every", type=float, default=4.0, help="s between two kills")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    random = stream(args.seed, "dying workers")
    folder = Path(tempfile.mkdtemp())
    machines = Machines(args.workers, folder)
    began = time.monotonic()
    try:
        running = campaign(
            folder / "cluster", args.trials, "--executor", "dask",
            DASK_SCHEDULER_ADDRESS=machines.address,
        )  # fmt: skip
        time.sleep(10.0)  # for the workers to come
        while running.poll() is None:
            machines.kill_one(int(random.integers(args.workers)))
            time.sleep(args.every)
        summary = json.loads(running.communicate()[0])
    finally:
        machines.close()
    took = time.monotonic() - began
    peace = campaign(folder / "peace", args.trials)
    peace.communicate()
    disturbed, undisturbed = outcomes(folder / "cluster"), outcomes(folder / "peace")
    print(
        json.dumps(
            {
                "kills": machines.killed,
                "trials": len(disturbed),
                "lost": len(undisturbed.keys() - disturbed.keys()),
                "doubled": sum(len(told) > 1 for told in disturbed.values()),
                "different": sum(disturbed.get(n) != told for n, told in undisturbed.items()),
                "errors": summary["errors"],
                "left_running": machines.left_running,
                "wall_s": round(took, 1),
            }
        )
    )
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
