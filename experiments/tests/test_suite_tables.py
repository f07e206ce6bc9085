"""Searches of a suite are counted when their directories are gone."""

import argparse
import json
import math
import shutil

import pytest

from experiments.falsification.kept import KEPT, KEPT_POOLS, Search, all_pools, all_searches, keep
from experiments.falsification.pairs import read_suite
from experiments.falsification.pools import Pool
from experiments.falsification.tables import searches_table
from experiments.falsification.uniform import ALL, beside_uniform, expected_curve
from mrta_falsify.campaigns.executors import SerialExecutor
from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Store
from mrta_falsify.campaigns.survival import SearchCost
from mrta_falsify.core.errors import InputError
from mrta_falsify.commands.search_outcomes import SearchOutcome
from tests.campaigns.standin import settings

PAIRS = [read_suite()[name] for name in ("two_doors", "lift_line")]


def run(folder, *, seed, stop_after=1, budget=40):
    executor = SerialExecutor(SerialExecutor.Options())
    with Store.create(folder, settings(seed=seed, jittered=1)) as store:
        executor.open(store.settings)
        run_campaign(store, Limits(budget=budget, stop_after=stop_after), executor)


def options(folder, **changed) -> argparse.Namespace:
    known = {"directory": folder, "output": folder / "kept", "budget": 40, "code": "abc"}
    return argparse.Namespace(**(known | changed))


def tables(folder):
    """Rows without knife edges and with them."""
    searches = all_searches(PAIRS, options(folder)).values()
    for edges in (False, True):
        known = [search for search in searches if search.knife_edges == edges]
        yield searches_table(PAIRS, known, 40)[0]


@pytest.fixture
def ran(tmp_path):
    """Two searches of one pair, one of another, and a pool."""
    for pair, seed in (("two_doors", 0), ("two_doors", 1), ("lift_line", 0)):
        run(tmp_path / "searches" / pair / "auto" / str(seed), seed=seed)
    run(tmp_path / "rates" / "lift_line", seed=7, stop_after=0, budget=60)
    return tmp_path


def test_searches_that_were_kept_count_as_those_of_a_directory(ran):
    before = all_searches(PAIRS, options(ran))
    pools = all_pools(PAIRS, options(ran))
    rows = list(tables(ran))
    assert [row.sampler for row in rows[0]["lift_line"]] == ["random", "auto"]
    assert [(row.sampler, row.searches) for row in rows[0][ALL]][1] == ("auto", 3)
    keep(PAIRS, options(ran))
    for gone in ("searches", "rates"):
        shutil.rmtree(ran / gone)
    assert all_searches(PAIRS, options(ran)) == before
    assert list(tables(ran)) == rows
    assert pools["lift_line"].trials == 60
    assert all_pools(PAIRS, options(ran)) == pools


def test_a_pool_takes_the_place_of_searches_of_random(ran):
    run(ran / "searches" / "lift_line" / "random" / "9", seed=9)
    seeds = {seed for pair, name, _, seed in all_searches(PAIRS, options(ran)) if name == "random"}
    assert seeds
    assert 9 not in seeds


def test_a_pool_that_was_interrupted_before_its_first_draw_is_none(ran):
    shutil.rmtree(ran / "rates")
    with Store.create(ran / "rates" / "lift_line", settings(seed=7, jittered=1)):
        pass
    run(ran / "searches" / "lift_line" / "random" / "9", seed=9)
    assert all_pools(PAIRS, options(ran)) == {}
    assert ("lift_line", "random", False, 9) in all_searches(PAIRS, options(ran))


def test_rows_are_the_same_when_they_are_kept_again(ran):
    keep(PAIRS, options(ran))
    rows = (ran / "kept" / KEPT).read_text()
    shutil.rmtree(ran / "searches")
    keep(PAIRS, options(ran))
    assert (ran / "kept" / KEPT).read_text() == rows


def test_keeping_again_replaces_the_same_searches_and_adds_others(ran):
    keep(PAIRS, options(ran))
    rows = len(all_searches(PAIRS, options(ran)))
    shutil.rmtree(ran / "searches" / "two_doors" / "auto" / "0")
    run(ran / "searches" / "two_doors" / "auto" / "2", seed=2)
    keep(PAIRS, options(ran, code="def"))
    found = all_searches(PAIRS, options(ran / "elsewhere", output=ran / "kept"))
    assert len(found) == rows + 2  # with knife edges and without
    assert found["two_doors", "auto", False, 0].code == "abc"
    assert found["two_doors", "auto", False, 1].code == "def"


def test_what_was_found_after_the_budget_was_not_found_in_it(ran):
    of = all_searches(PAIRS, options(ran))["two_doors", "auto", False, 0]
    assert of.outcome.simulations.found
    spent = int(of.outcome.simulations.spent)
    assert of.within(spent) is of.outcome
    cut = of.within(spent - 1)
    assert (cut.simulations.spent, cut.simulations.found, cut.modes) == (spent - 1, False, ())


@pytest.mark.parametrize("name", [KEPT, KEPT_POOLS])
def test_a_row_with_other_fields_is_told_of(ran, name):
    keep(PAIRS, options(ran))
    path = ran / "kept" / name
    row = json.loads(path.read_text().splitlines()[0])
    path.write_text(json.dumps(row | {"luck": 1}))
    with pytest.raises(InputError, match=f"{name}: luck is not a known field"):
        (all_searches if name == KEPT else all_pools)(PAIRS, options(ran))


def searched(pair, *costs, sampler="auto"):
    """Searches of a pair by what they spent; those below 0 found nothing."""
    for seed, spent in enumerate(costs):
        cost = SearchCost(spent=abs(spent), found=spent > 0)
        outcome = SearchOutcome(simulations=cost, seconds=cost, trials=abs(spent), modes=())
        yield Search(
            pair=pair, sampler=sampler, knife_edges=False, seed=seed, code="", outcome=outcome
        )


def pool(pair, wanted, trials) -> Pool:
    share = (0.0, 0.0, 1.0)
    return Pool(
        pair=pair, k=3, trials=trials, not_run=0, failed=2 * wanted, share=share, wanted=wanted,
        wanted_share=share, modes=1, by={}, best=0.0, sim_s=1.0, wall_s=1.0,
    )  # fmt: skip


def test_searches_are_compared_with_pools_by_their_shares():
    searches = [
        *searched("a", 5, 10, 5, -20),
        *searched("b", 15, 25, 20, 35),  # two of them after the budget
        *searched("c", 3),
        *searched("a", 1, 1, sampler="random"),
    ]
    pools = [pool("a", 10, 1000), pool("b", 4, 200), pool("d", 1, 10)]
    a, b, both = beside_uniform(searches, pools, 20, knife_edges=False)
    assert [row.pair for row in (a, b, both)] == ["a", "b", ALL]
    assert (a.failures, a.simulations, a.drawn_failures, a.draws) == (3, 40.0, 10, 1000)
    assert a.times == pytest.approx((1000 / 10) / (40 / 3))
    assert a.low < a.times < a.high
    share = 40 / 1040  # of the 13 failures that is to be expected
    at_least = [math.comb(13, k) * share**k * (1 - share) ** (13 - k) for k in range(3, 14)]
    assert a.p == pytest.approx(sum(at_least))
    assert a.holm_p == pytest.approx(2 * a.p)
    assert (b.failures, b.simulations) == (2, 75.0)
    assert b.times == pytest.approx(50 / 37.5)
    assert b.low < 1.0 < b.high
    assert b.p == b.holm_p > 0.5
    assert both.times == pytest.approx((100 + 50) / (40 / 3 + 37.5))
    assert both.low < both.times < both.high


def test_where_nothing_has_failed_nothing_is_told():
    (row, _) = beside_uniform(searched("a", -50), [pool("a", 0, 100)], 60, knife_edges=True)
    assert (row.failures, row.drawn_failures, row.p) == (0, 0, 1.0)
    assert (row.low, row.high) == (0.0, float("inf"))


def test_searches_of_uniform_draws_are_expected_to_fail_as_the_pools_did():
    times, share = expected_curve([pool("a", 1, 2), pool("b", 0, 2)], 2, knife_edges=False)
    assert times.tolist() == [0, 1, 2]
    assert share.tolist() == [1.0, (0.5 + 0.75) / 2, (0.25 + 0.5625) / 2]
    _, with_edges = expected_curve([pool("a", 1, 2)], 1, knife_edges=True)
    assert with_edges.tolist() == [1.0, 0.0]
