"""A campaign that the clock ends."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.campaigns import runner
from mrta_falsify.campaigns.settings import MAX_TRIALS, Limits
from mrta_falsify.campaigns.store import Store, read_campaign_settings
from mrta_falsify.cli.options import Duration
from mrta_falsify.commands.campaign import resume_campaign, run_store
from mrta_falsify.core.config import Choice
from tests.campaigns import standin


@pytest.fixture
def hours(monkeypatch):
    """The clock of the search, in hours; each look at it takes a quarter of an hour."""
    now = [0.0]

    def look() -> float:
        now[0] += 0.25
        return now[0] * 3600.0

    monkeypatch.setattr(runner.time, "monotonic", look)
    return now


def begun(directory, **limits):
    with Store.create(directory, dataclasses.replace(standin.settings(), budget=0)) as store:
        return run_store(store, Limits(budget=MAX_TRIALS, **limits), Choice("serial"))


def test_no_trial_is_begun_when_the_time_is_over_and_those_begun_are_kept(tmp_path, hours):
    result = begun(tmp_path / "c", wall_clock=3600.0)
    assert result.ended == "clock"
    assert 0 < result.progress.ran < 8
    assert result.progress.ran == len(result.campaign.records)


def test_it_goes_on_by_the_clock_with_the_trials_of_one_campaign(tmp_path, hours):
    first = begun(tmp_path / "c", wall_clock=3600.0)
    again = resume_campaign(tmp_path / "c", wall_clock=3600.0, executor="serial")
    assert again.ended == "clock"
    assert again.progress.ran > first.progress.ran
    assert read_campaign_settings(tmp_path / "c").budget == 0
    whole = standin.settings()
    with Store.create(tmp_path / "whole", whole) as store:
        ran = run_store(store, Limits(budget=again.progress.ran), Choice("serial"))
    points = [
        [record.candidate.u.tolist() for record in one.campaign.records] for one in (again, ran)
    ]
    assert points[0] == points[1]


def test_a_budget_ends_it_before_the_clock(tmp_path, hours):
    with Store.create(tmp_path / "c", standin.settings()) as store:
        result = run_store(store, Limits(budget=2, wall_clock=1e6), Choice("serial"))
    assert (result.ended, result.progress.ran) == ("budget", 2)


@pytest.mark.parametrize(
    ("text", "seconds"), [("8h", 28800.0), ("1h30m", 5400.0), ("90s", 90.0), ("5min", 300.0)]
)
def test_times_are_read_with_their_units(text, seconds):
    assert Duration().convert(text, None, None) == seconds


@pytest.mark.parametrize("text", ["8", "h", "", "-3h", "8 hours", "0h"])
def test_a_time_without_a_unit_is_refused(cli, text):
    result = cli("campaign", "bookshelf", "-o", "c", "--for", text)
    assert result.exit_code == 2
    assert "is no time; give one as 8h, 1h30m or 90s" in result.stderr
