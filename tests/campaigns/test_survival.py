from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.campaigns import survival
from mrta_falsify.campaigns.survival import SearchCost
from mrta_falsify.core.seeding import stream


def _searches(found, missed=()):
    return [SearchCost(spent=s, found=True) for s in found] + [
        SearchCost(spent=s, found=False) for s in missed
    ]


def test_without_missed_searches_the_restricted_mean_is_the_mean():
    assert survival.restricted_mean(_searches([3, 5, 10]), 100) == pytest.approx(6.0)


def test_a_missed_search_counts_with_its_whole_budget():
    searches = _searches([10, 30], missed=[100, 100])
    assert survival.restricted_mean(searches, 100) == pytest.approx((10 + 30 + 100 + 100) / 4)
    assert survival.median(searches) == 30
    assert survival.median(_searches([10], missed=[100, 100])) == float("inf")
    assert survival.found_share(searches).value == 0.5


def test_a_search_that_was_cut_short_leaves_the_others_their_weight():
    # Kaplan-Meier by hand: at 4 one of three fails (2/3), 5 is censored, at 9 one of one.
    times, share = survival.survival_curve(_searches([4, 9], missed=[5]))
    np.testing.assert_allclose(times, [0, 4, 5, 9])
    np.testing.assert_allclose(share, [1, 2 / 3, 2 / 3, 0])


def test_the_log_rank_test_tells_quick_from_slow_and_not_equal_from_equal():
    quick, slow = _searches(range(1, 11)), _searches(range(50, 60))
    assert survival.log_rank(quick, slow) < 1e-3
    assert survival.log_rank(quick, quick) == pytest.approx(1.0)
    assert survival.log_rank(_searches([], [9, 9]), _searches([], [9])) == 1.0
    assert survival.log_rank(_searches([], [5]), _searches([7])) == 1.0  # nobody left to compare


@pytest.mark.parametrize(
    ("samples", "least"),
    [pytest.param(6, 5, marks=pytest.mark.slow), pytest.param(60, 50, marks=pytest.mark.long)],
)
def test_the_bootstrap_interval_holds_the_true_mean_about_as_often_as_it_says(samples, least):
    hits = 0
    for seed in range(samples):
        spent = np.ceil(stream(seed, "test").exponential(20.0, size=25))
        found = spent <= 60
        searches = [
            SearchCost(spent=float(min(s, 60)), found=bool(f))
            for s, f in zip(spent, found, strict=True)
        ]
        interval = survival.restricted_mean_interval(searches, 60, seed=seed)
        q = np.exp(-1 / 20)
        truth = (1 - q**60) / (1 - q)
        hits += interval.low <= truth <= interval.high
    assert hits >= least


def test_what_searches_without_a_failure_spent_is_shared_by_the_failures_found():
    searches = [
        SearchCost(spent=10, found=True),
        SearchCost(spent=100, found=False),
        SearchCost(spent=40, found=True),
    ]
    assert survival.spent_per_failure(searches) == 75.0
    assert survival.spent_per_failure(searches[1:2]) == float("inf")
    found = survival.spent_per_failure_interval(searches)
    assert found.low <= found.value == 75.0 <= found.high
