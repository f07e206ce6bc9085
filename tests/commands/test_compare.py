"""Which directory a comparison of samplers may go on with."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.campaigns.store import SETTINGS, StoreError
from mrta_falsify.commands import searches
from mrta_falsify.commands.search_outcomes import sampler_rows
from mrta_falsify.commands.searches import (
    ComparisonPlan,
    check_is_comparison,
    outcomes,
    run_searches,
)
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from tests.campaigns import standin


def plan(**changes):
    settings = standin.settings()
    trials = dataclasses.replace(settings.trials, **changes)
    return ComparisonPlan(
        settings=dataclasses.replace(settings, trials=trials),
        samplers=("random",),
        repeats=0,
        budget=1,
    )


@pytest.mark.parametrize("there", ["nothing", "a file", "a campaign"])
def test_what_is_no_comparison_is_not_gone_on_with(tmp_path, there):
    if there == "a file":
        (tmp_path / "notes.txt").write_text("mine")
    elif there == "a campaign":
        (tmp_path / SETTINGS).write_text("{}")
    with pytest.raises(StoreError, match="is not a comparison"):
        check_is_comparison(tmp_path)


def test_a_comparison_that_was_begun_is_known_again(tmp_path):
    run_searches(plan(), tmp_path)
    check_is_comparison(tmp_path)
    run_searches(plan(), tmp_path)


@pytest.mark.slow
def test_searches_side_by_side_give_the_same_table_as_one_after_the_other(tmp_path):
    whole = dataclasses.replace(plan(), samplers=("random", "sobol"), repeats=2, budget=15)
    tables = []
    for workers in (1, 2):
        folder = tmp_path / f"{workers}"
        folder.mkdir()
        run_searches(whole, folder, workers=workers)
        found = outcomes(whole, folder)
        assert [len(rows) for rows in found.values()] == [2, 2]
        rows = sampler_rows(found, whole.budget)
        tables.append(
            [{k: v for k, v in codec.encode(row).items() if "seconds" not in k} for row in rows]
        )
    assert tables[0] == tables[1]


def runs_standins():
    """Run searches in a process that knows the stand-in, since this module imports it."""
    return searches._search


@pytest.mark.slow
def test_only_searches_that_are_missing_or_cut_short_are_run(tmp_path, monkeypatch):
    monkeypatch.setattr(searches, "_runs_searches", runs_standins)
    whole = dataclasses.replace(plan(), repeats=3, budget=6, stop_after=0)
    run_searches(dataclasses.replace(whole, repeats=1), tmp_path)
    run_searches(dataclasses.replace(whole, repeats=2, budget=4), tmp_path)
    lines = []
    run_searches(whole, tmp_path, on_search=lambda done, total, text: lines.append(text))
    assert [line.split(":")[0] for line in lines] == ["random, seed 1", "random, seed 2"]
    ran = [rows.trials for rows in outcomes(whole, tmp_path)["random"]]
    assert ran == [6, 6, 6]


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"scenario": "elsewhere"}, "scenario"),
        ({"stack": StackConfig(planner=Choice("ompl"))}, "stack"),
        ({"specifications": ("deadlines",)}, "specifications"),
        ({"params": {"n": 2}}, "parameters"),
    ],
)
def test_a_comparison_of_something_else_is_not_gone_on_with(tmp_path, changes, name):
    run_searches(plan(), tmp_path)
    with pytest.raises(StoreError, match=f"compares samplers with other {name}"):
        run_searches(plan(**changes), tmp_path)
