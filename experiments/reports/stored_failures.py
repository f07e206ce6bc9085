"""Failed trials of stored campaigns as the cases of a study, and rows that outlive the process."""

from __future__ import annotations

import dataclasses
import json
import resource
import shutil
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns import journal
from mrta_falsify.campaigns.journal import read_rows
from mrta_falsify.campaigns.store import SETTINGS, Campaign
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import write_world
from mrta_falsify.lab.stored import stored_world
from mrta_falsify.commands.stored_trials import open_campaign


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredFailure:
    """A failed trial of a campaign."""

    campaign: Campaign
    record: TrialRecord

    @property
    def name(self) -> str:
        """Unique among campaigns of different directories."""
        return f"{self.campaign.directory}/{self.record.id}"

    @property
    def scenario(self) -> str:
        """Name of the program without its folder."""
        return Path(self.campaign.settings.trials.scenario).stem

    @property
    def mode(self) -> tuple[str, str, tuple[str, ...]]:
        """Signature, scenario and planted defects."""
        return self.record.signature, self.scenario, self.campaign.settings.trials.stack.defects

    def facts(self) -> dict[str, Any]:
        """Begin a row of a study: what every row says first."""
        stack = self.campaign.settings.trials.stack
        return {
            "case": self.name,
            "campaign": self.campaign.directory.name,
            "trial": self.record.id,
            "scenario": self.scenario,
            "defects": list(stack.defects),
            "engine": self.record.engine,
            "signature": self.record.signature,
        }

    def kept_apart(self, folder: Path) -> Campaign:
        """Move the campaign's directory to ``folder``, so that its own stays untouched.

        Raises:
            InputError: the trial's world is missing.
        """
        number = "-".join(self.campaign.directory.resolve().parts[-2:])
        apart = dataclasses.replace(self.campaign, directory=folder / number)
        files = apart.folder(self.record)
        files.mkdir(parents=True, exist_ok=True)
        shutil.copy(self.campaign.directory / SETTINGS, apart.directory / SETTINGS)
        write_world(stored_world(self.campaign, self.record), files / "world.json")
        return apart


def stored_failures(
    directories: Sequence[Path], *, per_mode: int, part: tuple[int, int] = (1, 1)
) -> list[StoredFailure]:
    """List failures of all campaigns under some directories, one of each mode first.

    Args:
        directories: campaigns, or folders with campaigns at any depth.
        per_mode: failures of one signature, scenario and set of defects at most.
        part: i of n: only every n-th case, begun at the i-th, to divide the work.
    """
    modes: dict[Any, list[StoredFailure]] = {}
    roots = sorted({file.parent for path in directories for file in path.rglob(SETTINGS)})
    for root in roots:
        campaign = open_campaign(root)
        for record in campaign.records:
            if record.failed:
                failure = StoredFailure(campaign=campaign, record=record)
                modes.setdefault(failure.mode, []).append(failure)
    chosen = [
        failures[turn]
        for turn in range(per_mode)
        for _, failures in sorted(modes.items())
        if turn < len(failures)
    ]
    which, parts = part
    return chosen[which - 1 :: parts]


def parse_part(text: str) -> tuple[int, int]:
    """Read ``2/3`` as (2, 3).

    Raises:
        InputError: not of that form.
    """
    first, _, second = text.partition("/")
    if not (first.isdigit() and second.isdigit() and 1 <= int(first) <= int(second)):
        raise InputError(f"--part {text}: it must read I/N with 1 <= I <= N, as 1/2")
    return int(first), int(second)


def rows_of(folder: Path, study: str) -> list[dict[str, Any]]:
    """Read the rows of all parts of a study; a torn last line is left out."""
    return [row for path in sorted(folder.glob(f"{study}*.jsonl")) for row in read_rows(path)]


def append_row(folder: Path, study: str, part: tuple[int, int], row: dict[str, Any]) -> None:
    """Add a row; it is on disc when this returns."""
    name = study if part[1] == 1 else f"{study}.{part[0]}of{part[1]}"
    journal.append_row(folder / f"{name}.jsonl", row)


def study_options(description: str, *, max_runs: int, per_signature: int) -> ArgumentParser:
    """Build the command line that all studies share."""
    parser = ArgumentParser(description=description)
    parser.add_argument("directories", type=Path, nargs="*")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--max-cases", type=int, default=1000)
    parser.add_argument("--max-runs", type=int, default=max_runs)
    parser.add_argument("--per-signature", type=int, default=per_signature)
    parser.add_argument("--part", default="1/1")
    parser.add_argument("--table", action="store_true", help="only sum up what is there")
    return parser


def run_study(
    name: str,
    options: Namespace,
    study: Callable[[StoredFailure, Path], dict[str, Any]],
    table: Callable[[list[dict[str, Any]]], str],
) -> None:
    """Study the cases that have no row yet, then print the table of all rows.

    Args:
        name: of the study and its files in ``options.output``.
        options: as of :func:`study_options`.
        study: the row of a case; may write into the folder.
        table: of rows.
    """
    options.output.mkdir(parents=True, exist_ok=True)
    part = parse_part(options.part)
    done = {row["case"] for row in rows_of(options.output, name)}
    cases = stored_failures(options.directories, per_mode=options.per_signature, part=part)
    for case in [] if options.table else cases[: options.max_cases]:
        if case.name not in done:
            row = study(case, options.output / "cases")
            append_row(options.output, name, part, row)
            print(json.dumps(row), flush=True)
    print(table(rows_of(options.output, name)))


def cpu_seconds() -> float:
    """Add up the CPU time of this process and of the copies it has waited for [s]."""
    copies = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + copies.ru_utime + copies.ru_stime
