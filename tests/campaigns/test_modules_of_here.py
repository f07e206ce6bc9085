"""Modules of the current directory: those that were named, after all others, and no others."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mrta_falsify.campaigns.executors import ProcessExecutor
from mrta_falsify.campaigns.settings import CampaignSettings, TrialSettings
from mrta_falsify.campaigns.store import StoreError, read_campaign_settings
from mrta_falsify.core import codec
from mrta_falsify.core.modules import SAFE_PATH, look_here_for, place_of
from mrta_falsify.process.pool import Pool

LIBRARY = ("queue", "click", "statistics", "multiprocessing", "pickle", "runpy")
TRIALS = """
import os
import helper_of_mine

def open_here(settings):
    return lambda job: {"number": job["number"], "safe": os.environ.get("PYTHONSAFEPATH")}
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A current directory with modules that are called as those of the library."""
    for name in (*LIBRARY, "never_asked"):
        text = f"import pathlib; pathlib.Path({str(tmp_path / 'RAN')!r}).write_text({name!r})"
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "mine_of_here.py").write_text(TRIALS)
    (tmp_path / "helper_of_mine.py").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place not in ("", ".")])
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])
    yield tmp_path
    for name in ("mine_of_here", "helper_of_mine"):
        sys.modules.pop(name, None)


def test_only_what_was_named_is_found_here(here: Path) -> None:
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("mine_of_here")
    assert place_of("mine_of_here:Planner".partition(":")[0]) == here / "mine_of_here.py"
    assert "mine_of_here" not in sys.modules
    look_here_for("mine_of_here")
    assert importlib.import_module("mine_of_here").open_here
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("never_asked")
    look_here_for("statistics")
    sys.modules.pop("statistics", None)
    importlib.import_module("statistics")
    assert not (here / "RAN").exists()


def test_a_worker_takes_no_library_from_here(here: Path) -> None:
    settings = CampaignSettings(
        trials=TrialSettings(scenario="none"), target="mine_of_here:open_here"
    )
    executor = ProcessExecutor(ProcessExecutor.Options())
    try:
        executor.open(settings)
        executor.submit({"number": 0, "u": []})
        done = ()
        while not done:
            done = executor.collect(1.0)
    finally:
        executor.close()
    assert done[0].record == {"number": 0, "safe": None}
    assert not (here / "RAN").exists()


def _calls():
    return _call


def _call(asked):
    function, arguments = asked
    return function(*arguments)


def test_a_pool_takes_no_library_from_here(here: Path) -> None:
    before = dict(os.environ)
    with Pool(_calls) as pool:
        asked = [(os.getcwd, ()), (os.getenv, (SAFE_PATH,))]
        found = dict(pool.unordered(asked))
        assert found == {0: str(here), 1: before.get(SAFE_PATH)}
    assert dict(os.environ) == before
    assert not (here / "RAN").exists()


@pytest.mark.parametrize("module", ["mrta_falsify", "mrta_falsify.cli"])
def test_the_command_takes_no_library_from_here(module: str, here: Path) -> None:
    words = [sys.executable, "-m", module, "--version"]
    assert subprocess.run(words, capture_output=True, check=False).returncode == 0
    assert not (here / "RAN").exists()


@pytest.mark.parametrize("named", ["mrta_falsify.worker:open_trials", "trials"])
def test_a_campaign_of_an_older_version_runs_trials(tmp_path: Path, named: str) -> None:
    settings = codec.encode(CampaignSettings(trials=TrialSettings(scenario="none")))
    (tmp_path / "campaign.json").write_text(json.dumps({**settings, "target": named}))
    assert read_campaign_settings(tmp_path).target == "trials"


@pytest.mark.parametrize("named", ["mine_of_here:open_here", "experiments", 3])
def test_a_campaign_names_no_function_of_its_own(tmp_path: Path, named: object) -> None:
    settings = codec.encode(CampaignSettings(trials=TrialSettings(scenario="none")))
    (tmp_path / "campaign.json").write_text(json.dumps({**settings, "target": named}))
    with pytest.raises(StoreError, match=r"campaign\.json: target is .*; it must be trials"):
        read_campaign_settings(tmp_path)
