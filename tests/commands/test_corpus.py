"""Stored failures on a changed stack."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.commands import corpus
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.lab import laboratory
from mrta_falsify.trial import Job, judge, on_kinematic_engine
from tests.failing_stacks import Sleeps
from tests.reports.planted import BROKEN, stored


@pytest.mark.usefixtures("in_process")
@pytest.mark.slow
def test_a_failure_is_fixed_on_a_stack_without_its_defect_and_stays_on_its_own(campaign):
    told = []
    (row,) = corpus.recheck(campaign, jittered=1, on_done=told.append)
    assert row.fate == "still failing"
    assert row.signature_now == row.signature
    assert row.violated == ("no_deadlock",)
    assert row.jittered == 1
    assert told == [row]
    (cured,) = corpus.recheck(campaign, config=on_kinematic_engine(StackConfig()), jittered=1)
    assert (cured.fate, cured.violated, cured.jittered_failures) == ("fixed", (), 0)
    assert corpus.counts_by_fate([row, cured]) == {
        "fixed": 1,
        "still failing": 1,
        "flaky": 0,
        "timeout": 0,
        "not judged": 0,
    }


@pytest.mark.usefixtures("in_process")
@pytest.mark.slow
def test_a_failure_that_cannot_be_judged_any_more_is_not_fixed(stalled, tmp_path):
    world, _ = stalled
    job = Job(world=world, config=BROKEN, early_stop=True, specifications=("all_tasks_done",))
    failed = stored(tmp_path / "late", job, judge(job))
    silent = dataclasses.replace(BROKEN, withheld=("deliveries",))
    (row,) = corpus.recheck(failed, config=silent, jittered=0)
    assert (row.fate, row.violated) == ("not judged", ())


@pytest.mark.usefixtures("in_process")
def test_a_damaged_world_is_refused_with_its_file(campaign):
    path = campaign.directory / "trials" / "0000" / "world.json"
    path.write_text('{"name": "half a wor')
    with pytest.raises(InputError, match=r"world\.json: is not valid JSON"):
        corpus.recheck(campaign, jittered=0)


@pytest.mark.slow
def test_a_run_that_exceeds_its_time_limit_is_killed_and_reported(campaign):
    asleep = dataclasses.replace(BROKEN, controller=Choice(f"{Sleeps.__module__}:Sleeps"))
    rows = corpus.recheck(campaign, config=asleep, jittered=0, workers=2, time_limit=1.0)
    assert [row.fate for row in rows] == ["timeout"]
    assert rows[0].signature_now == ""


def test_a_campaign_without_failures_starts_no_worker(campaign, monkeypatch):
    monkeypatch.setattr(laboratory, "local_workers", None)
    assert corpus.recheck(dataclasses.replace(campaign, records=())) == ()


@pytest.mark.parametrize(
    ("stack", "settings", "names"),
    [
        (None, (), False),
        ("planner: ompl\n", (), False),
        ("planner: ompl\nengine: kinematic\n", (), True),
        ("", ("planner=ompl",), False),
        (None, ("planner=ompl", "engine=kinematic"), True),
        (None, ("engine.time_step=0.01",), True),
    ],
)
def test_an_engine_is_named_in_the_file_or_by_set(tmp_path, stack, settings, names):
    path = None
    if stack is not None:
        path = tmp_path / "stack.yaml"
        path.write_text(stack)
    assert corpus.names_engine(path, settings) is names


def test_a_changed_stack_is_put_on_the_recorded_engine(campaign):
    changed = StackConfig(planner=Choice("ompl"))
    kept = corpus.on_recorded_engine(campaign, changed)
    assert (kept.engine.name, kept.planner.name) == ("kinematic", "ompl")
