"""Kinds of failure in order: a secondary specification ends no trial and is not what is wanted."""

import dataclasses

import pytest

from mrta_falsify.campaigns.runner import feedback_of
from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.record import PerturbedRuns
from mrta_falsify.lab import Vote, open_program
from mrta_falsify.specs.objectives import search_score
from mrta_falsify.testing.records import changed
from mrta_falsify.trial import campaign_specifications, primary_and_secondary
from mrta_falsify.worker import TrialRunner

KINEMATIC = StackConfig(engine=Choice("kinematic"))
LATE = """
model scenic_worlds.model
new Robot with name 'robot1', with start_room 0
param tasks = [(0, 1, 4, Range(25, 26))]
param horizon = 40
"""


# --- the order ---------------------------------------------------------------------------------


def test_without_a_word_late_and_undone_tasks_come_last():
    specs, then = primary_and_secondary()
    assert then == ("deadlines", "all_tasks_done")
    assert set(specs) == set(campaign_specifications())
    assert specs[-len(then) :] == then


def test_specifications_that_the_user_names_are_alike_unless_said_otherwise():
    assert primary_and_secondary(["no_deadlock", "deadlines"]) == (("no_deadlock", "deadlines"), ())
    assert primary_and_secondary(["no_deadlock"], ["deadlines"]) == (
        ("no_deadlock", "deadlines"),
        ("deadlines",),
    )


def test_something_must_come_first():
    with pytest.raises(ConfigError, match="--secondary-spec deadlines: is all that is judged"):
        primary_and_secondary(["deadlines"], ["deadlines"])


def test_what_comes_last_counts_half_and_is_no_violation_of_the_score():
    margins = {"no_deadlock": 0.8, "deadlines": -1.0}
    assert search_score(margins) == -1.0
    assert 0.0 < search_score(margins, then=["deadlines"]) < 0.8
    assert search_score({**margins, "deadlines": 1.0}, ["deadlines"]) > search_score(
        margins, ["deadlines"]
    )


# --- a trial -------------------------------------------------------------------------------------


def trial(tmp_path, then: tuple[str, ...], jittered: int = 0):
    path = tmp_path / "late.scenic"
    path.write_text(LATE)
    settings = TrialSettings(
        scenario=str(path),
        stack=KINEMATIC,
        specifications=("no_deadlock", "deadlines"),
        then=then,
        jittered=jittered,
    )
    program = open_program(settings)
    candidate = program.candidate(0)
    return TrialRunner(settings, program).run(0, candidate.u)


def test_a_missed_deadline_ends_a_trial_only_if_it_is_looked_for_first(tmp_path):
    then = ("deadlines",)
    first, last = trial(tmp_path, ()), trial(tmp_path, then, jittered=2)
    assert (first.ended, last.ended) == ("decided", "horizon")
    assert first.failed
    assert first.is_robust
    assert last.failed
    assert not last.is_robust
    assert last.rank == "secondary"
    assert last.vote is None
    told = feedback_of(last, Cube(), then)
    assert not told.failed
    assert told.signature == ""
    assert told.score > 0.0
    assert last.result.margins["deadlines"] < 0.0
    assert set(told.objectives) == {"no_deadlock"}


# --- copies --------------------------------------------------------------------------------------


@pytest.mark.parametrize("most", [1, 2, 4, 5, 8])
def test_copies_end_once_the_rest_cannot_change_what_most_do(most):
    for number in range(2**most):
        fails = [bool(number >> i & 1) for i in range(most)]
        whole = PerturbedRuns(runs=most, failed=sum(fails))
        runs = next(n for n in range(most + 1) if Vote.of(fails[:n]).is_settled(most))
        some = PerturbedRuns(runs=runs, failed=sum(fails[:runs]))
        assert some.robust == whole.robust
        assert not any(Vote.of(fails[:n]).is_settled(most) for n in range(runs))


def test_what_comes_last_is_listed_last_however_often_it_failed(stalled, campaign):
    from mrta_falsify.commands.stored_trials import open_campaign

    opened = open_campaign(campaign.directory)
    record = opened.records[0]
    late = changed(
        record,
        candidate=dataclasses.replace(record.candidate, number=1),
        signature="deadlines",
        rank="secondary",
    )
    many = dataclasses.replace(opened, records=(late, late, late, record))
    assert [mode.signature for mode in many.stats().modes] == [record.signature, "deadlines"]
    assert [mode.is_afterthought for mode in many.stats().modes] == [False, True]
