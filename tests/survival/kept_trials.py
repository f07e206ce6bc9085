"""Trials in closed form that keep the files of a run, for campaigns on bad disks."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from mrta_falsify.campaigns.settings import STORED_TARGETS, CampaignSettings, TrialSettings
from mrta_falsify.core.world import World
from mrta_falsify.worker import TrialFiles
from tests.campaigns import standin
from tests.conftest import hall_world, scripted_trace

TARGET = "tests.survival.kept_trials:open_trials"
STORED_TARGETS[TARGET] = TARGET  # so that such a campaign can be read


@functools.cache
def run() -> tuple[World, Any]:
    """Give a world, and as much of an outcome as is kept."""
    world = hall_world()
    return world, SimpleNamespace(trace=scripted_trace(world, seconds=4.0), transcript=None)


def open_trials(settings: TrialSettings) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Run the trials of the stand-in, each with the files of :func:`run`."""
    judge, files = standin.open_trials(settings), TrialFiles.of(settings.directory)
    world, outcome = run()

    def trial(job: dict[str, Any]) -> dict[str, Any]:
        record = judge(job)
        assert files is not None
        if "result" in record:
            record["result"]["trace_file"] = files.write(world, outcome, job["number"])
            record["result"]["trace"] = outcome.trace.digest
        return record

    return trial


def kept_settings(directory: str, **options: Any) -> CampaignSettings:
    """Settings of a campaign over these trials in ``directory``."""
    chosen = standin.settings(**options)
    trials = dataclasses.replace(chosen.trials, directory=directory)
    return dataclasses.replace(chosen, trials=trials, target=TARGET)
