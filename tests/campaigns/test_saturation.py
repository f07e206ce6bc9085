"""What uniform trials leave unseen, and campaigns that stop once that is little."""

import numpy as np
import pytest

from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.saturation import Saturation
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.stats import CampaignStats
from mrta_falsify.campaigns.store import Store
from mrta_falsify.commands.workers import open_executor
from mrta_falsify.core.config import Choice
from mrta_falsify.core.seeding import stream

from .standin import settings


def unseen(*trials: str):
    saturation = Saturation()
    for trial in trials:
        saturation.take(trial)
    return saturation.unseen()


def test_without_trials_nothing_is_known():
    found = unseen()
    assert (found.estimate, found.low, found.high) == (None, 0.0, 1.0)


def test_the_estimate_is_the_share_of_trials_that_show_what_no_other_does():
    found = unseen("ab", "abc", "b", "bd", "")
    assert (found.trials, found.situations, found.estimate) == (5, 4, 2 / 5)
    assert found.low < 0.4 < found.high


def test_trials_that_all_show_the_same_leave_less_unseen_the_more_there_are():
    highs = [unseen(*["ab"] * n).high for n in (2, 10, 50)]
    assert highs[0] > highs[1] > highs[2]
    assert unseen(*["ab"] * 50).low == 0.0


def test_situations_shown_twice_widen_the_interval():
    assert unseen(*["ab"] * 8, "cd", "cd").high > unseen(*["ab"] * 10).high


def test_the_upper_end_is_above_the_true_chance_as_often_as_it_says():
    chance = 0.9 * np.arange(1, 101, dtype=float) ** -1.2
    above = 0
    for number in range(200):
        shows = stream(number, "shows").random((60, len(chance))) < chance
        saturation = Saturation()
        for row in shows:
            saturation.take([str(one) for one in np.flatnonzero(row)])
        truth = 1.0 - np.prod(1.0 - chance[~shows.any(axis=0)])
        above += truth > saturation.unseen().high
    assert above <= 10  # 2.5 % of 200, and what chance adds


@pytest.mark.parametrize(("limit", "expected"), [(0.3, "saturated"), (0.0, "budget")])
def test_a_campaign_stops_once_little_is_unseen(tmp_path, limit, expected):
    chosen = settings(sampler=Choice("random"), dimensions=2)
    with (
        Store.create(tmp_path, chosen) as store,
        open_executor(store.settings, Choice("serial")) as executor,
    ):
        limits = Limits(budget=60, until_saturated=limit)
        progress, ended = run_campaign(store, limits, executor)
        stats = CampaignStats(chosen)
        stats.take_all(store.campaign().records[: progress.told])
    assert ended == expected
    found = progress.unseen
    assert found == stats.unseen
    assert found.trials == progress.ran
    if limit:
        assert progress.ran < 60
        assert found.high < limit
