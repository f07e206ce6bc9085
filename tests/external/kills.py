"""kill -9 of a stack, a worker, a campaign: is anything lost, doubled, different or left running?

    python -m tests.external.kills --kills 50

One campaign runs episodes with a foreign stack, with two workers. Again and again
a stack, a worker or the campaign itself is killed at a random moment, each as often as asked; a
campaign that was killed is resumed. In turn the stack is plain, has children, has children with
sessions of their own, or hangs when a copy of the run asks it to fork. What an episode gives
depends on that alone, so every record can be compared with that of an episode in peace.

A stack that was killed crashed, and its record says so. All other records must be those of peace.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.campaigns.runner import point_digest
from mrta_falsify.campaigns.settings import STORED_TARGETS, TrialSettings
from mrta_falsify.campaigns.store import Store, read_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.record import Origin, TrialRecord
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.seeding import candidate_seed, stream
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import run_supervised
from simulator_interface.episode import Episode
from simulator_interface.external.branching import CannotBranch
from tests.campaigns.standin import settings as standin_settings
from tests.external.garbled.garbled_stacks import MARK, ROOT, left_with
from tests.external.garbled.rightful import hall
from tests.survival.kills import children, durable, is_alive, work

MODES = ("plain", "children", "sessions", "hangs")
VICTIMS = ("stack", "worker", "campaign")
PROGRAM = "tests.external.killed_stack"
TICKS, COPIED_AT = 20, 8  # of an episode; from which a copy goes on
PAUSES = (0.05, 1.0)  # s between two kills
ENDLESS = 10**6  # trials
PATIENCE = 10.0  # s until all that a killed process had started has ended
FURTHER = 4  # trials after the last kill
TARGET = "tests.external.kills:open_trials"
STORED_TARGETS[TARGET] = TARGET  # so that such a campaign can be read


@dataclass
class Report:
    """What the kills did."""

    kills: dict[str, int] = field(default_factory=lambda: dict.fromkeys(VICTIMS, 0))
    records: int = 0
    crashed_stacks: int = 0  #: records that say so
    lost: int = 0  #: records that were durable before a kill and not after it, or never came
    doubled: int = 0
    different: int = 0  #: records that are neither those of peace nor say that a stack was killed
    left: int = 0  #: processes that outlived what had started them
    examples: list[str] = field(default_factory=list)


# --- a trial ---------------------------------------------------------------------------------


def open_trials(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Open the trials of a campaign; see :func:`episode`."""
    mark = settings.params["mark"]

    def trial(job: dict[str, Any]) -> dict[str, Any]:
        number, u = job["number"], np.asarray(job["u"])
        digest, said = episode(MODES[number % len(MODES)], mark)
        record = TrialRecord(
            candidate=Candidate(number=number, u=u, seed=candidate_seed(settings.seed, number)),
            origin=Origin(proposal=point_digest(u)),
            result=RunResult(status="judged", trace=digest, signature=said),
        )
        return codec.encode(record)

    return trial


def episode(mode: str, mark: str) -> tuple[str, str]:
    """Run an episode and a copy of it; digests of what was answered, and how the stack failed."""
    stack = ExternalStack(
        command=(sys.executable, "-m", PROGRAM, mode),
        folder=str(ROOT),
        env={"PYTHONPATH": str(ROOT), MARK: mark},
        tick_limit=3.0 if mode == "hangs" else 60.0,
    )
    running = Episode(
        hall(), dataclasses.replace(StackConfig(), engine=Choice("kinematic"), stack=stack)
    )
    frames = running.frames()

    def further() -> str:
        for _ in range(TICKS - COPIED_AT):
            next(frames)
        return str(running.state.digest())

    def apart() -> str:
        running.become_copy()
        return further()

    try:
        for _ in range(COPIED_AT):
            next(frames)
        try:
            copied = run_supervised(apart)
        except StackFailed as failed:  # of a copy that was killed only the connection is known
            return "", f"copy: {failed}"
        return f"{further()} {copied}", ""
    except StackFailed as failed:
        return "", f"{failed.failure.kind}: {failed}"
    except (CannotBranch, Ending) as error:
        return "", f"copy: {error}"
    finally:
        frames.close()


# --- kills -----------------------------------------------------------------------------------


def disturb(directory: Path, kills: int, seed: int) -> Report:
    """Kill each kind of victim ``kills`` times; afterwards go on in peace and compare."""
    report, random = Report(), stream(seed, "kills")
    mark = f"{os.getpid()}-{time.monotonic_ns()}"
    chosen = standin_settings(seed=seed, window=8, mark=mark)
    chosen = dataclasses.replace(chosen, target=TARGET)
    Store.create(directory, chosen).close()
    wanted = [victim for victim in VICTIMS for _ in range(kills)]
    random.shuffle(wanted)
    while wanted:
        before = durable(directory)
        with subprocess.Popen(
            [sys.executable, "-m", "tests.external.kills", "--work", str(directory),
             "--budget", str(ENDLESS)],
            stderr=subprocess.DEVNULL,
        ) as process:  # fmt: skip
            _kill_until_campaign(process, wanted, report, random)
        report.lost += len(set(before) - set(durable(directory)))
        print(f"{sum(report.kills.values())} kills", file=sys.stderr, flush=True)
    numbers = [record.number for record in read_campaign(directory).records]
    work(directory, max(numbers, default=0) + 1 + FURTHER)
    _compare(directory, report, mark)
    report.left += len(left_with(mark, PATIENCE))
    return report


def _kill_until_campaign(
    process: subprocess.Popen[bytes], wanted: list[str], report: Report, random: np.random.Generator
) -> None:
    """Kill what is wanted, until it was the campaign or nothing is left to kill."""
    while process.poll() is None:
        time.sleep(random.uniform(*PAUSES))
        victim = wanted[-1] if wanted else "campaign"
        workers = children(process.pid)
        chosen = {
            "campaign": [process.pid] if workers else [],
            "worker": workers,
            "stack": [pid for worker in workers for pid in stacks_below(worker)],
        }[victim]
        if not chosen:
            continue
        number = int(random.choice(sorted(chosen)))
        family = list(below(number))
        try:
            os.kill(number, signal.SIGKILL)
        except ProcessLookupError:
            continue
        if wanted:
            report.kills[wanted.pop()] += 1
        if victim == "campaign":
            process.wait()
        if victim != "stack":  # its children are the keeper's until the episode ends
            report.left += _still_alive(family)


def below(parent: int) -> Iterator[int]:
    """List all processes below another one."""
    for child in children(parent):
        yield child
        yield from below(child)


def stacks_below(parent: int) -> list[int]:
    found = []
    for pid in below(parent):
        try:
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if PROGRAM.encode() in words:
            found.append(pid)
    return found


def _still_alive(pids: list[int]) -> int:
    until = time.monotonic() + PATIENCE
    while any(map(is_alive, pids)) and time.monotonic() < until:
        time.sleep(0.05)
    return sum(map(is_alive, pids))


def _compare(directory: Path, report: Report, mark: str) -> None:
    peace = functools.cache(lambda mode: episode(mode, mark))
    records = list(read_campaign(directory).records)
    numbers = [record.number for record in records]
    report.records = len(records)
    report.doubled = len(numbers) - len(set(numbers))
    report.lost += max(numbers) + 1 - len(set(numbers))
    for record in records:
        wanted = peace(MODES[record.number % len(MODES)])
        if (record.trace_digest, record.signature) == wanted:
            continue
        said = record.signature or record.error
        is_crash = said == "crash: the stack ended by SIGKILL" or said.startswith("copy: ")
        report.crashed_stacks += is_crash
        if not is_crash:
            report.different += 1
            report.examples.append(f"{record.id} {record.status}: {said[-300:]}")
    if report.crashed_stacks > report.kills["stack"]:
        report.different += report.crashed_stacks - report.kills["stack"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--work", type=Path, help="(internal) go on with this campaign")
    parser.add_argument("--budget", type=int, default=0, help="(internal) until there are so many")
    arguments = parser.parse_args()
    if arguments.work:
        work(arguments.work, arguments.budget)
        return
    with tempfile.TemporaryDirectory() as folder:
        report = disturb(Path(folder), arguments.kills, arguments.seed)
    print(json.dumps(asdict(report), indent=1))
    sys.exit(bool(report.lost or report.doubled or report.different or report.left))


if __name__ == "__main__":
    main()
