"""Deadlock, stuck and shut by the world are counted apart, and add up."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import mrta_falsify as mf
from mrta_falsify.campaigns.record_formats import flat_record
from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.runner import Progress, feedback_of
from mrta_falsify.campaigns.settings import CampaignSettings, Limits, TrialSettings
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.campaigns.store import Store, read_campaign
from mrta_falsify.cli import main
from mrta_falsify.commands.campaign import CampaignResult
from mrta_falsify.commands.campaign_summary import summarise_campaign
from mrta_falsify.core.config import Choice, ExternalStack, StackConfig
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.perturbed_runs import NO_COMPARISON, trial_score
from mrta_falsify.specs.attribution import WORLD, suspect
from mrta_falsify.specs.causes import group_of, kind_of
from mrta_falsify.specs.descriptors import Descriptors
from mrta_falsify.specs.objectives import objectives
from mrta_falsify.testing.records import trial_record
from mrta_falsify.trial import SETTLE, Job, Judged, TrialWatch

LAST = ("deadlines", "all_tasks_done")


def violated(spec, who=("robot1",), **evidence):
    return Verdict(
        spec=spec, robustness=-1.0, violated=True, violated_at=50.0, who=who, evidence=evidence
    )


def claimed(kind, *members):
    place = {"x": 1.0, "y": 1.0, "near": "ward_1", "distance": 0.2, "kind": "doorway"}
    rows = [{"robot": m, "cause": "wall", "blocked_by": "", "resource": "bed1"} for m in members]
    bed = {"name": "bed1", "kind": "furniture", "carried_by": "porter1"}
    return violated(
        "no_deadlock", members, kind=kind, members=list(members), cycle=rows, chain=[],
        onset=40.0, place=place, objects=[bed], shut_by=["bed1"], shut_room="ward_1",
        shut_since=30.0,
    )  # fmt: skip


SETTINGS = CampaignSettings(
    trials=TrialSettings(scenario="by hand", specifications=("no_deadlock", "progress"), then=LAST),
    cube=Cube(dimensions=1),
    rules=RULES,
    sampler=Choice("random"),
)
HOLDS = Verdict(spec="no_deadlock", robustness=20.0, violated=False)
RUNS = (
    (claimed("deadlock", "robot1", "robot2"),),
    (claimed("deadlock", "robot3", "robot2"), violated("deadlines", ())),
    (claimed("stuck", "robot1"),),
    (claimed("shut", "robot1"), violated("progress"), violated("deadlines", ())),
    (claimed("shut", "robot2"),),
    (claimed("shut", "robot2"), violated("no_robot_robot_contact", ("robot1", "robot3"))),
    (violated("progress"),),
    (HOLDS, violated("deadlines", ())),
    (HOLDS,),
)


def judged(verdicts):
    return Judged(
        outcome=None, verdicts=verdicts, margins=objectives(verdicts), descriptors={}, then=LAST
    )  # type: ignore[arg-type]


def record_of(number, verdicts):
    run = judged(verdicts)
    result = RunResult(
        status="judged",
        verdicts=verdicts,
        margins=run.margins,
        rank=run.rank,
        signature=signature(verdicts),
    )
    score = trial_score(run, NO_COMPARISON)
    return trial_record(number, np.zeros(1), result=result, score=score)


@pytest.fixture(scope="module")
def directory(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("kinds") / "c"
    with Store.create(place, SETTINGS) as store:
        for number, verdicts in enumerate(RUNS):
            store.add(record_of(number, verdicts))
    return place


@pytest.fixture(scope="module")
def summary(directory):
    campaign = read_campaign(directory)
    progress = Progress(campaign.settings, limits=Limits(budget=len(RUNS)))
    progress.take_all(campaign.records)
    return summarise_campaign(
        CampaignResult(campaign=campaign, progress=progress, ended="budget", wall_s=1.0)
    )


def test_the_kinds_add_up_to_all_failures(directory, summary):
    assert summary.kinds == {"deadlock": 2, "stuck": 1, "shut": 2, "other": 2}
    assert summary.failed == sum(summary.kinds.values()) + summary.afterthoughts == 8
    assert summary.deadlocks == 6  # trials that violate ``no_deadlock``, as before
    assert read_campaign(directory).stats().kinds == summary.kinds


def test_a_shut_place_is_neither_sought_nor_wanted_nor_the_first_failure():
    progress = Progress(SETTINGS, limits=Limits(budget=9, stop_after=1))
    for number, verdicts in enumerate((RUNS[3], RUNS[4], RUNS[2])):
        record = record_of(number, verdicts)
        progress.take(record)
        told = feedback_of(record, Cube(dimensions=1), LAST)
        is_shut = number < 2
        assert record.failed
        assert (record.is_primary, record.is_robust, group_of(record.result) == "shut") == (
            not is_shut,
            not is_shut,
            is_shut,
        )
        assert record.rank == ("secondary" if is_shut else "primary")
        assert (record.score < 0.0, told.failed, told.score < 0.0) == (not is_shut,) * 3
        assert ("no_deadlock" in told.objectives) != is_shut
        assert progress.has_enough != is_shut
    assert (progress.first_failure, progress.robust, progress.failed) == (3, 1, 3)


def test_modes_go_from_deadlocks_to_what_the_world_shut_and_what_was_late(directory):
    found = read_campaign(directory).stats().modes
    assert [mode.kind for mode in found] == ["deadlock", "stuck", "", "", "shut", ""]
    assert [mode.is_afterthought for mode in found] == [False] * 5 + [True]
    assert found[4].signature == "no_deadlock/shut:pushed furniture/doorway"
    assert found[4].count == 2


@pytest.mark.parametrize("foreign", [False, True])
def test_a_shut_place_is_of_no_layer_of_any_stack(foreign):
    stack = ExternalStack(command=("x",)) if foreign else None
    config = StackConfig(stack=stack)
    assert suspect(config, RUNS[3], None) == WORLD  # type: ignore[arg-type]


def _json(*words):
    return json.loads(CliRunner().invoke(main, [*words, "--format", "json"]).stdout)


def test_list_show_frame_and_report_tell_the_kind(directory, tmp_path):
    kinds = [kind_of(verdicts) for verdicts in RUNS]
    assert [row.get("kind", "") for row in _json("list", str(directory))] == kinds
    assert list(mf.open_campaign(directory).frame()["kind"]) == kinds
    shown = _json("show", str(directory), "0004")
    assert shown["kind"] == "shut"
    assert shown["happened"][0].startswith("ward_1 is shut by bed1 (pushed by porter1) since 30 s")
    assert shown["signature_before"] == "no_deadlock/1:wall/doorway with pushed furniture"
    text = CliRunner().invoke(main, ["show", str(directory), "0004"]).stdout
    assert "kind       shut by the world" in text
    assert "deadlock" not in text.replace("no_deadlock", "").replace("near_deadlock", "")
    page = tmp_path / "r.md"
    done = CliRunner().invoke(
        main, ["report", str(directory), "-o", str(tmp_path / "r.html"), "--markdown", str(page)]
    )
    assert done.exit_code in (0, 1), done.output
    said = page.read_text()
    assert "2 deadlocks, 1 stuck, 2 failed otherwise; 2 shut by the world; 1 only deadlines" in said


def test_a_campaign_of_earlier_rules_is_not_labelled_anew(tmp_path):
    recorded = Path(__file__).parent.parent / "recorded" / "campaigns" / "stalls"
    for record in read_campaign(recorded).records:
        assert record.rank == ("primary" if record.failed else "none")
        assert "signature_before" not in flat_record(record, rules=1)
        assert kind_of(record.verdicts) == ("stuck" if record.failed else "")
    rows = _json("list", str(recorded))
    assert all(row["signature"].startswith("no_deadlock/1:") for row in rows if row["failed"])


class Scripted:
    """A specification whose verdict is given."""

    def __init__(self, verdict):
        self._verdict = verdict

    def verdict(self):
        return self._verdict


@pytest.mark.parametrize(
    ("verdicts", "ends_at"),
    [
        (RUNS[0], 50.0 + SETTLE),
        (RUNS[2], 50.0 + SETTLE),
        (RUNS[3], None),  # nothing but what follows from the shut place
        (RUNS[4], None),
        ((claimed("shut", "robot2"), dataclasses.replace(RUNS[6][0], violated_at=80.0)), 83.0),
        (RUNS[7], None),
    ],
)
def test_a_shut_place_ends_no_run_early(verdicts, ends_at, monkeypatch, hall):
    monkeypatch.setattr(Descriptors, "update", lambda self, frame: None)
    job = Job(world=hall, config=StackConfig(), early_stop=True, then=LAST)
    watch = TrialWatch(job, tuple(map(Scripted, verdicts)))
    times = [tick / 20.0 for tick in range(20 * 120)]
    ended = (t for t in times if watch.stop(frame_at(t)))
    assert next(ended, None) == ends_at


def frame_at(time):
    return SimpleNamespace(sensed=SimpleNamespace(time=time, tick=round(time * 20)))


def test_what_follows_from_a_shut_place_is_scored_like_what_is_looked_for_last():
    assert judged(RUNS[3]).secondary == {"no_deadlock", "progress", *LAST}
    contact = judged(RUNS[5])
    assert contact.secondary == {"no_deadlock", *LAST}
    assert contact.is_primary
    assert trial_score(contact, NO_COMPARISON) < 0.0
    assert not dataclasses.replace(contact, verdicts=RUNS[4]).is_primary
