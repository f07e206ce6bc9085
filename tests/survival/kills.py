"""kill -9 at random moments: is anything lost, doubled, or different afterwards?

    python -m tests.survival.kills --kills 100

Runs one campaign over a stand-in scenario (closed form, a few milliseconds a trial) in a process
of its own, kills the parent or one of its workers at a random moment, again and again, resumes
each time, and compares the log with that of a campaign that was left in peace.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from mrta_falsify.campaigns.executors import ProcessExecutor
from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import RECORDS, Store, read_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.seeding import stream
from tests.campaigns.standin import settings

WORKERS = 2


@dataclass
class Report:
    """What 100 kills did."""

    kills: int = 0
    of_parent: int = 0
    of_worker: int = 0
    torn_lines: int = 0  #: found after a kill
    lost: int = 0  #: records that were durable before a kill and not after it
    doubled: int = 0
    different: int = 0  #: records that differ from the undisturbed campaign's
    orphans: int = 0  #: workers alive 1 s after their parent's death
    slowest_resume_s: float = 0.0  #: from start of the process to its first new record
    median_resume_s: float = 0.0
    rounds: int = 0


def work(directory: Path, budget: int) -> None:
    """Go on with the campaign in ``directory`` until ``budget``."""
    executor = ProcessExecutor(ProcessExecutor.Options(workers=WORKERS))
    fresh: list[int] = []

    def on_record(record: TrialRecord, is_new: bool) -> None:
        if is_new and not fresh:
            fresh.append(record.number)
            print("first new record", file=sys.stderr, flush=True)

    with Store.resume(directory) as store:
        try:
            executor.open(store.settings)
            run_campaign(store, Limits(budget=budget), executor, on_record=on_record)
        finally:
            executor.close()


def durable(directory: Path) -> list[str]:
    """Whole lines of the log."""
    text = (directory / RECORDS).read_bytes()
    return [line.decode() for line in text.splitlines(keepends=True) if line.endswith(b"\n")]


def children(parent: int) -> list[int]:
    """Processes whose parent is ``parent``."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == parent:
                found.append(int(entry.name))
    return found


def is_alive(pid: int) -> bool:
    """Whether a process still runs; one that nobody has waited for does not."""
    try:
        return (Path(f"/proc/{pid}") / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def disturb(directory: Path, kills: int, budget: int, seed: int) -> Report:
    """Run to ``budget`` with ``kills`` kills; afterwards compare with a campaign in peace."""
    report, random = Report(), stream(seed, "survival")
    chosen = settings(seed=seed, reject_above=0.9, sleep=0.004, window=8)
    Store.create(directory, chosen).close()
    resumes: list[float] = []
    while True:
        report.rounds += 1
        before = durable(directory)
        began = time.monotonic()
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "tests.survival.kills",
                "--work",
                str(directory),
                "--budget",
                str(budget),
            ],
            stderr=subprocess.PIPE,
        )
        first = process.stderr.readline() if process.stderr else b""
        if first:
            resumes.append(time.monotonic() - began)
        while report.kills < kills and process.poll() is None:
            time.sleep(random.uniform(0.0, 0.25))
            workers = children(process.pid)
            on_parent = random.random() < 0.6 or not workers
            victim = process.pid if on_parent else int(random.choice(sorted(workers)))
            if process.poll() is not None:
                break
            report.kills += 1
            os.kill(victim, signal.SIGKILL)
            if on_parent:
                report.of_parent += 1
                time.sleep(1.0)
                report.orphans += sum(is_alive(pid) for pid in workers)
                break
            report.of_worker += 1
        code = process.wait()
        if process.stderr:
            process.stderr.close()
        text = (directory / RECORDS).read_bytes()
        report.torn_lines += bool(text) and not text.endswith(b"\n")
        after = durable(directory)
        report.lost += sum(line not in set(after) for line in before)
        if code == 0:
            break
    report.slowest_resume_s = round(max(resumes, default=0.0), 2)
    report.median_resume_s = round(statistics.median(resumes or [0.0]), 2)
    numbers = [record.number for record in read_campaign(directory).records]
    report.doubled = len(numbers) - len(set(numbers))
    with tempfile.TemporaryDirectory() as name:
        peace = Path(name)
        Store.create(peace, chosen).close()
        work(peace, budget)
        calm = {record.number: codec.encode(record) for record in read_campaign(peace).records}
    stormy = {record.number: codec.encode(record) for record in read_campaign(directory).records}
    wrong = [n for n in calm.keys() | stormy.keys() if calm.get(n) != stormy.get(n)]
    report.different = len(wrong)
    return report


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--budget", type=int, default=8000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--work", type=Path, help="(internal) go on with this campaign")
    arguments = parser.parse_args()
    if arguments.work:
        work(arguments.work, arguments.budget)
        return
    with tempfile.TemporaryDirectory() as folder:
        report = disturb(Path(folder), arguments.kills, arguments.budget, arguments.seed)
    print(json.dumps(asdict(report), indent=1))


if __name__ == "__main__":
    main()
