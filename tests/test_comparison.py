"""Which directory a comparison of samplers may go on with."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify import comparison
from mrta_falsify.campaign.store import SETTINGS, StoreError
from mrta_falsify.core.config import Choice, StackConfig
from tests.campaign import standin


def plan(**changes):
    settings = standin.settings()
    trials = dataclasses.replace(settings.trials, **changes)
    return comparison.Plan(
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
        comparison.check_is_comparison(tmp_path)


def test_a_comparison_that_was_begun_is_known_again(tmp_path):
    assert comparison.run(plan(), tmp_path, Choice("processes"))
    comparison.check_is_comparison(tmp_path)
    assert comparison.run(plan(), tmp_path, Choice("processes"))


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
    comparison.run(plan(), tmp_path, Choice("processes"))
    with pytest.raises(StoreError, match=f"compares samplers with other {name}"):
        comparison.run(plan(**changes), tmp_path, Choice("processes"))
