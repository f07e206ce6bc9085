from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mrta_falsify.campaigns.statistics import why_no_probability
from mrta_falsify.core.config import Choice
from mrta_falsify.core.probability import blaker_interval, failure_probability
from tests.campaigns.standin import settings


@pytest.mark.parametrize("trials", [1, 5, 20, 60])
def test_the_interval_covers_every_probability_at_least_as_often_as_it_says(trials):
    ends = np.array([blaker_interval(k, trials) for k in range(trials + 1)])
    for p in np.linspace(0.003, 0.997, 141):
        weights = stats.binom.pmf(np.arange(trials + 1), trials, p)
        covered = (ends[:, 0] <= p) & (p <= ends[:, 1])
        assert weights[covered].sum() >= 0.95 - 1e-9


@pytest.mark.parametrize("trials", [10, 50, 200])
def test_it_is_never_wider_than_clopper_and_pearsons(trials):
    for k in range(0, trials + 1, max(1, trials // 25)):
        low, high = blaker_interval(k, trials)
        other = stats.binomtest(k, trials).proportion_ci(method="exact")
        assert other.low - 1e-9 <= low <= k / trials <= high <= other.high + 1e-9


def test_it_is_the_same_for_failures_and_for_passes():
    low, high = blaker_interval(3, 40)
    mirrored = blaker_interval(37, 40)
    assert (1.0 - mirrored[1], 1.0 - mirrored[0]) == pytest.approx((low, high))


def test_the_ends_are_zero_and_one_where_nothing_or_all_failed():
    assert blaker_interval(0, 10)[0] == 0.0
    assert blaker_interval(10, 10)[1] == 1.0
    low, high = blaker_interval(5, 10)
    assert low + high == pytest.approx(1.0)


def test_errors_widen_the_interval_both_ways():
    plain = failure_probability(5, 100)
    unsure = failure_probability(5, 100, undecided=10)
    assert unsure.low < plain.low
    assert unsure.high > plain.high
    assert unsure.estimate == plain.estimate == 0.05


def test_without_trials_nothing_is_known():
    unknown = failure_probability(0, 0)
    assert (unknown.low, unknown.high) == (0.0, 1.0)


def test_a_search_gets_no_interval_and_is_told_why():
    assert "looks for failures" in why_no_probability(
        settings(sampler=Choice("evolution")), any_uniform=False, stopped_early=False
    )
    assert "use --mode exact" in why_no_probability(
        settings(), any_uniform=True, stopped_early=False, accepted=(1, 9)
    )


def test_a_search_is_told_all_that_an_interval_needs_at_once():
    told = why_no_probability(
        settings(sampler=Choice("evolution")), any_uniform=False, stopped_early=False
    )
    assert "use --sampler random with --mode exact" in told
    own = why_no_probability(
        settings(sampler=Choice("auto")), any_uniform=False, stopped_early=False
    )
    assert "no trial counts yet" in own
    assert "use --sampler" not in own


def test_mode_exact_is_not_advised_where_it_would_reject_all():
    told = why_no_probability(settings(), any_uniform=True, stopped_early=False, accepted=(0, 9))
    assert "none of 9 proposals" in told
    assert "use --mode exact" not in told
