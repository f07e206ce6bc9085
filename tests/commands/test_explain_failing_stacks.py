"""A stack that fails in a changed continuation leaves ``explain`` an answer."""

from __future__ import annotations

import dataclasses
import os

import pytest

from mrta_falsify.analysis.explain.changes import Change
from mrta_falsify.analysis.explain.rows import experiment_of, failure_of, fate_of
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.lab import Lab
from mrta_falsify.stack.resources.policies import DeadlineFirst
from mrta_falsify.testing import planted as worlds
from mrta_falsify.trial import Job, judge, on_kinematic_engine


def raises(self, waiters):
    raise ValueError("cannot order them")


def ends_its_process(self, waiters):
    os._exit(7)


@pytest.mark.slow
@pytest.mark.parametrize("fails", [raises, ends_its_process])
def test_a_change_under_which_the_stack_fails_does_not_remove_the_failure(monkeypatch, fails):
    monkeypatch.setattr(DeadlineFirst, "order", fails)
    job = Job(
        world=worlds.room_freed_while_parked(0),
        config=on_kinematic_engine(StackConfig(defects=("room_freed_while_parked",))),
        specifications=("exclusive_use",),
        early_stop=True,
    )
    judged = judge(job)
    (verdict,) = judged.verdicts
    failure = failure_of(job, verdict, judged.outcome)
    changed = dataclasses.replace(job.config, queue_policy=Choice("deadline_first"))
    change = Change(layer="queue_policy", text="deadline_first", config=changed)
    result = Lab().run(experiment_of(job, failure, 0.5, change, 0))
    assert fate_of(result, failure) == "otherwise"
