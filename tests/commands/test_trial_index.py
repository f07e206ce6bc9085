"""The index beside the log: it says what the log says, or it is not believed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.campaigns import made_here, trial_index
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import RECORDS, SETTINGS, Store, read_campaign, read_trial
from mrta_falsify.campaigns.trial_index import INDEX, read_index, rows_data, write_index
from mrta_falsify.cli import main
from mrta_falsify.commands import campaign as campaigns
from mrta_falsify.commands.report.build import index_of, short_summary
from mrta_falsify.commands.stored_trials import list_trials, show_trial, trial_rows
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from tests.campaigns.standin import settings

RECORDED = Path(__file__).parent.parent / "recorded" / "campaigns"


@pytest.fixture
def directory(tmp_path):
    """A campaign with explained failures, and its index."""
    place = Path(shutil.copytree(RECORDED / "beds", tmp_path / "c"))
    made_here.write_seal(place, {})
    write_index(place, index_of(read_campaign(place)))
    explained = place / "trials" / "0003" / "explain.json"
    explained.write_text(json.dumps(json.loads(explained.read_text()) | {"layer": "planner"}))
    return place


def listed(directory, *options):
    done = CliRunner().invoke(main, ["list", str(directory), *options])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_list_from_the_index_is_that_from_the_log(directory, monkeypatch):
    campaign = read_campaign(directory)
    rows = trial_rows(campaign)
    assert rows[3].layer == "planner" != campaign.record(3).layer
    summary = short_summary(campaign, {row.id: row.layer for row in rows})
    index = read_index(directory)
    assert trial_index.index_summary(index, trial_index.explained_rows(directory, index)) == summary
    forms = ([], ["--failed"], ["--format", "json"], ["--failed", "--format", "csv"])
    with monkeypatch.context() as patch:  # the log is not decoded
        patch.setattr("mrta_falsify.core.codec.decode", None)
        patch.setattr(trial_index, "_explained_layer", lambda directory, row: "planner")
        by_index = [listed(directory, *form) for form in forms]
    assert list_trials(directory) == rows
    (directory / INDEX).unlink()
    assert by_index == [listed(directory, *form) for form in forms]
    assert json.dumps(rows_data(rows)) == json.dumps(codec.encode(rows))


@pytest.mark.parametrize("change", ["log", "settings", "index", "kind", "link", "seal"])
def test_an_index_of_anything_else_is_not_believed(directory, change):
    assert read_index(directory) is not None
    log, own = directory / RECORDS, directory / INDEX
    if change == "seal":  # somebody else has made it
        (directory / made_here.SEAL).unlink()
    elif change == "log":  # of the same length
        log.write_bytes(log.read_bytes().replace(b"0.67", b"0.68", 1))
    elif change == "settings":
        path = directory / SETTINGS
        path.write_text(json.dumps(json.loads(path.read_text()) | {"budget": 9}))
    elif change == "index":
        own.write_bytes(own.read_bytes().replace(b"0003", b"0004", 1))
    elif change == "kind":
        text = own.read_text().split("\t", 1)[1].replace('"failed":[false', '"failed":["no"', 1)
        text = text.rstrip("\n")
        own.write_text(f"{trial_index._checksum(text)}\t{text}\n")
    else:
        own.rename(directory.parent / "elsewhere")
        own.symlink_to(directory.parent / "elsewhere")
    assert read_index(directory) is None


def test_who_writes_a_large_campaign_writes_its_index_and_a_reader_does_not(tmp_path, monkeypatch):
    monkeypatch.setattr(campaigns, "INDEXED", 6)
    monkeypatch.setattr(campaigns, "ScenePreflight", lambda trials: None)
    with Store.create(tmp_path / "c", settings()) as store:
        for budget in (5, 7):
            campaigns.run_store(store, Limits(budget=budget), Choice("serial"))
            assert (read_index(tmp_path / "c") is not None) == (budget == 7)
    rows = list_trials(tmp_path / "c")
    assert rows == trial_rows(read_campaign(tmp_path / "c"))
    assert len(rows) == 7
    (tmp_path / "c" / INDEX).unlink()
    list_trials(tmp_path / "c")
    assert not (tmp_path / "c" / INDEX).exists()


def test_one_trial_is_read_without_the_others(directory, monkeypatch):
    whole = read_campaign(directory)
    for name in (3, "3", "0003"):
        assert codec.encode(show_trial(directory, name)) == codec.encode(whole.record(3))
    assert len(read_trial(directory, 3).records) == 1
    with pytest.raises(Exception, match="trials 0000 to 0007"):
        show_trial(directory, 8)
