"""Is a report small and quick, whatever the campaign is?

    python -m experiments.reports.size [--from DIR] [--trials 10000] [-o FILE.json]

A real campaign (kinematic engine, a scenario of missed deadlines on the floor of a hospital;
one of its failures minimised, explained and replayed) is multiplied through the store's own
interface: the same runs under other numbers, in other modes and orders. Measured are bytes and
CPU seconds of the HTML, Markdown and JUnit reports of

- 20 failures in 20 trials, each with its smallest world,
- 100 failures in 100 trials, all shown in full (``--cases 100``),
- 10 000 trials, 3 of 10 failed, in 60 modes.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Campaign, Store, trial_folder
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.testing.records import changed
from mrta_falsify.commands import explain as explaining
from mrta_falsify.commands import minimize as minimising
from mrta_falsify.commands import report as reporting
from mrta_falsify.commands.campaign import open_store, run_store
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.replay import replay_trial, store_replay
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.commands.workers import local_workers

SCENARIO = "burst_of_tasks"
TRIALS = 6  # of the real campaign
MODES = 60  # of the large one


def real_campaign(directory: Path) -> Campaign:
    """Run a campaign with a few failures, one of them with every finding."""
    settings = new_settings(
        SCENARIO,
        output=directory,
        stack=StackConfig(engine=Choice("kinematic")),
        sampler=Choice("random"),
    )
    with open_store(directory, settings) as store:
        run_store(store, Limits(budget=TRIALS), local_workers(1))
    campaign = open_campaign(directory)
    first = next(record for record in campaign.records if record.failed)
    minimising.minimize(campaign, first, max_runs=40)
    explaining.explain(campaign, first, max_runs=12)
    store_replay(campaign, replay_trial(campaign, first, times=2))
    return campaign


def multiply(
    campaign: Campaign, directory: Path, trials: int, *, failed_in_ten: int, modes: int
) -> Campaign:
    """Make a campaign of ``trials`` from the records and files of another one.

    Args:
        campaign: with failures and passes.
        directory: for the new one; must not exist.
        trials: of the new one.
        failed_in_ten: of every ten trials.
        modes: into which the failures are divided.
    """
    failures = [record for record in campaign.records if record.failed]
    dressed = [r for r in failures if (campaign.folder(r) / "minimize.json").is_file()]
    failures = dressed if failed_in_ten == 10 and dressed else failures
    passes = [record for record in campaign.records if record.status == "ok" and not record.failed]
    with Store.create(directory, campaign.settings) as store:
        for number in range(trials):
            is_failed = number % 10 < failed_in_ten
            source = failures[number % len(failures)] if is_failed else passes[number % len(passes)]
            store.add(_copy(source, number, modes))
            if is_failed:
                _link_files(campaign.folder(source), trial_folder(directory, number))
    return open_campaign(directory)


def _copy(source: TrialRecord, number: int, modes: int) -> TrialRecord:
    descriptors = {
        name: float(np.clip(value + 0.3 * np.sin(number + i), 0.0, 1.0))
        for i, (name, value) in enumerate(sorted(source.search.descriptors.items()))
    }
    signature = source.signature
    if signature and modes > 1:
        signature = f"{signature}/mode {number * number % modes}"
    return changed(
        source,
        candidate=dataclasses.replace(source.candidate, number=number),
        signature=signature,
        descriptors=descriptors,
        score=source.score * (1.0 + 0.2 * float(np.cos(number))),
    )


def _link_files(source: Path, target: Path) -> None:
    target.mkdir(parents=True)
    for path in source.iterdir():
        os.link(path, target / path.name)


def measure(campaign: Campaign, folder: Path, cases: int) -> dict[str, Any]:
    """Measure bytes and CPU seconds of each form of the report."""

    def write(name: str, text: Callable[[], str]) -> dict[str, float]:
        began = time.process_time()
        (folder / name).write_text(text(), encoding="utf-8")
        spent = time.process_time() - began
        return {"bytes": (folder / name).stat().st_size, "cpu_s": round(spent, 2)}

    def page() -> dict[str, float]:
        began = time.process_time()
        path = reporting.write_report(campaign, folder / "report.html", cases=cases)
        spent = time.process_time() - began
        shown = path.read_text(encoding="utf-8").count("<article ")
        return {"bytes": path.stat().st_size, "cpu_s": round(spent, 2), "cases": shown}

    began = time.process_time()
    open_campaign(campaign.directory)
    return {
        "trials": len(campaign.records),
        "open_cpu_s": round(time.process_time() - began, 2),
        "html": page(),
        "markdown": write("report.md", lambda: reporting.markdown_report(campaign)),
        "junit": write("report.xml", lambda: reporting.junit_report(campaign)),
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="source", type=Path, help="a campaign with failures")
    parser.add_argument("--trials", type=int, default=10_000, help="of the large campaign")
    parser.add_argument("--keep", type=Path, help="a new folder for the campaigns and reports")
    parser.add_argument("-o", "--output", type=Path)
    arguments = parser.parse_args()
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="report-size-"))
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.source is not None:
        # copied, so that files can be linked whatever file system it lies on
        shutil.copytree(arguments.source, folder / "real", dirs_exist_ok=True)
        source = open_campaign(folder / "real")
    else:
        source = real_campaign(folder / "real")
    rows = {}
    sizes = (("20 cases", 20, 10, 1, 20), ("100 cases", 100, 10, 1, 100))
    for name, trials, failed, modes, cases in (
        *sizes,
        (f"{arguments.trials} trials", arguments.trials, 3, MODES, reporting.MAX_CASES),
    ):
        directory = folder / name.replace(" ", "-")
        campaign = multiply(source, directory, trials, failed_in_ten=failed, modes=modes)
        rows[name] = measure(campaign, directory, cases)
        print(name, json.dumps(rows[name]), flush=True)
    if arguments.output:
        arguments.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if arguments.keep is None:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
