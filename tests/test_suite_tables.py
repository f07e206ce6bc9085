"""Searches of a suite are counted when their directories are gone."""

import argparse
import json
import shutil

import pytest

from benchmarks.falsification.kept import KEPT, all_searches, keep
from benchmarks.falsification.pairs import read_suite
from benchmarks.falsification.tables import ALL, searches_table
from mrta_falsify.campaigns.executors import SerialExecutor
from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Store
from mrta_falsify.core.errors import InputError
from tests.campaigns.standin import settings

PAIRS = [read_suite("v2")[name] for name in ("two_doors", "lift_line")]


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
    rows = list(tables(ran))
    assert [row.sampler for row in rows[0]["lift_line"]] == ["random", "auto"]
    assert [(row.sampler, row.searches) for row in rows[0][ALL]][1] == ("auto", 3)
    keep(PAIRS, options(ran))
    for gone in ("searches", "rates"):
        shutil.rmtree(ran / gone)
    assert all_searches(PAIRS, options(ran)) == before
    assert list(tables(ran)) == rows


def test_a_pool_takes_the_place_of_searches_of_random(ran):
    run(ran / "searches" / "lift_line" / "random" / "9", seed=9)
    seeds = {seed for pair, name, _, seed in all_searches(PAIRS, options(ran)) if name == "random"}
    assert seeds
    assert 9 not in seeds


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


def test_a_row_with_other_fields_is_told_of(ran):
    keep(PAIRS, options(ran))
    path = ran / "kept" / KEPT
    row = json.loads(path.read_text().splitlines()[0])
    path.write_text(json.dumps(row | {"luck": 1}))
    with pytest.raises(InputError, match=r"searches\.jsonl: luck is not a known field"):
        all_searches(PAIRS, options(ran))
