"""Rewinding finds when a failure was decided; runs are scripted but for the last test."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.analysis.explain import decided_sentences, rewinding
from mrta_falsify.analysis.explain.changes import Change
from mrta_falsify.analysis.explain.explaining import explain_job
from mrta_falsify.analysis.explain.rewinding import Branch, branches_of, rewind
from mrta_falsify.analysis.explain.rows import Failure
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.lab import RunResult
from mrta_falsify.testing.wards import ward_layout
from mrta_falsify.trial import Job
from tests.reports.planted import stalled_job

FOUND = 40.0  # s
VERDICT = Verdict(spec="no_deadlock", robustness=-1.0, violated=True, violated_at=FOUND)
FAILURE = Failure(verdict=VERDICT, found=FOUND, tasks=(), situation=None)
PASSED = Verdict(spec="no_deadlock", robustness=1.0, violated=False)
UNJUDGED = unjudged("no_deadlock", "nobody knows")


def _branch(name: str, number: int) -> Branch:
    config = StackConfig(control_rate=20 + number)  # tells the branches apart
    return Branch(
        replaced="layer", name=name, text=f"another {name.replace('_', ' ')}", config=config
    )


PLANNER, QUEUES = _branch("planner", 1), _branch("queue_policy", 2)
NAMES = {21: "planner", 22: "queue_policy"}


class _Lab:
    """A lab in which runs fail as a script says."""

    def __init__(self, fails, told, rounds) -> None:
        self._fails, self._told, self._rounds = fails, told, rounds

    def map(self, experiments):
        self._rounds.append(len(experiments))
        for experiment in experiments:
            (edit,) = experiment.edits
            name = NAMES[edit.stack.control_rate] if edit.stack is not None else ""
            self._told.append((name, edit.at, edit.nudge))
            failed = self._fails(name, edit.at, edit.nudge)
            verdict = {True: VERDICT, False: PASSED, None: UNJUDGED}[failed]
            yield RunResult(status="judged", verdicts=(verdict,), sim_time=100.0)


@pytest.fixture
def scripted(monkeypatch):
    """Rewinds a run in which copies fail as a script says."""

    def rewound(fails, *branches, most=400, why_not="", told=None, rounds=None):
        monkeypatch.setattr(rewinding, "_why_not", lambda job: why_not)
        job = Job(world=ward_layout(rooms=2), config=StackConfig(), specifications=("no_deadlock",))
        lab = _Lab(
            fails,
            told if told is not None else [],
            rounds if rounds is not None else [],
        )
        return rewind(job, FAILURE, branches, most, lab)

    return rewound


def test_the_time_until_which_a_layer_would_have_averted_the_failure_is_found(scripted):
    turns = {"": 0.0, "planner": 12.0, "queue_policy": 31.4}
    found = scripted(lambda name, time, number: time >= turns[name], PLANNER, QUEUES)
    assert found.by == "queue_policy"
    assert 31.4 <= found.decided_at <= 31.9
    stack, planner, queues = found.curves
    assert stack.open_until is None
    assert 11.5 <= planner.open_until < 12.0 <= planner.lost_from <= 12.5
    for point in (queues.at(queues.open_until), queues.at(queues.lost_from)):
        assert point.chance.trials >= 6
    first, *_ = decided_sentences(found, "queue_policy")
    assert first == f"It was decided at {found.decided_at:.1f} s, by the queue policy."
    first, *_ = decided_sentences(found, "")  # the rows name no layer
    assert first == f"It was decided at {found.decided_at:.1f} s."


def test_the_time_when_chance_alone_decided_it_is_found(scripted):
    turns = {"": 20.0, "planner": 20.0}
    found = scripted(lambda name, time, number: time >= turns[name] or number % 4 == 0, PLANNER)
    assert found.by == ""
    assert 20.0 <= found.decided_at <= 20.5
    assert "the one exchange tried would not have averted it" in decided_sentences(found, "")[0]


def test_times_next_to_the_turn_get_copies_until_one_half_is_left_out(scripted):
    found = scripted(lambda name, time, number: time >= 20.0 or number in (2, 7))
    before = found.curves[0].at(found.curves[0].open_until)
    assert before.chance.high < 0.5
    assert before.chance.trials > 6


def test_copies_are_bounded_and_what_there_were_none_for_is_named(scripted):
    told = []
    found = scripted(
        lambda name, time, number: time >= 31.0 * bool(name), PLANNER, QUEUES, most=45, told=told
    )
    assert found.runs == len(told) <= 45
    assert found.by == "planner"
    assert found.left_out == "another queue policy: no runs were left (--rewinds)"
    assert scripted(lambda name, time, number: True, most=2) is None


def test_what_cannot_be_judged_widens_the_interval(scripted):
    found = scripted(lambda name, time, number: None if number == 1 else True)
    assert found.curves[0].points[0].chance.undecided == 1
    found = scripted(lambda name, time, number: None)
    assert found.decided_at is None
    assert decided_sentences(found, "") == ()


def test_a_stack_that_fails_from_the_start_is_not_asked_again(scripted):
    told = []
    found = scripted(lambda name, time, number: time >= 31.0 * bool(name), PLANNER, told=told)
    assert found.by == "planner"
    assert [(time, number) for name, time, number in told if not name] == [
        (0.0, number) for number in range(1, 7)
    ]


def test_a_stack_that_fails_by_chance_is_asked_where_a_layer_helps(scripted):
    def fails(name, time, number):
        return time >= 31.0 if name else time > 0.0 or number % 3 != 0

    found = scripted(fails, PLANNER)
    assert found.by == "planner"
    assert found.curves[0].at(found.curves[1].open_until).chance.trials == 6


def test_the_run_goes_forward_once_for_a_round_of_questions(scripted):
    rounds = []
    scripted(lambda name, time, number: time >= 31.0 * bool(name), PLANNER, QUEUES, rounds=rounds)
    assert max(rounds) >= 2  # of both layers side by side
    assert len(rounds) < 60


def test_beside_a_shipped_layer_in_place_of_another_the_others_are_looked_at_less_closely(scripted):
    shipped = dataclasses.replace(PLANNER, restores=True)
    found = scripted(lambda name, time, number: time >= 31.0 * bool(name), shipped, QUEUES)
    _, planner, queues = found.curves
    assert planner.lost_from - planner.open_until <= 0.5
    assert 0.5 < queues.lost_from - queues.open_until <= 2.0


def test_what_cannot_be_rewound_is_said(scripted):
    reason = "the whole run: the stack cannot be copied while it runs"
    found = scripted(lambda name, time, number: True, PLANNER, why_not=reason)
    assert found.left_out == reason
    assert found.decided_at is None
    assert decided_sentences(found, "") == (f"Not rewound: {reason}.",)


def test_layers_that_removed_the_failure_are_replaced_and_shipped_ones_from_the_start():
    changes = [
        Change(layer=layer, text=f"another {layer}", config=StackConfig(), restores=restores)
        for layer, restores in (("queue_policy", False), ("planner", False), ("controller", True))
    ]
    job = Job(world=ward_layout(rooms=2), config=StackConfig())
    chosen = branches_of(job, FAILURE, changes, {"another planner"}, 12.0)
    assert [(b.name, b.restores, b.since) for b in chosen] == [
        ("controller", True, 0.0),
        ("planner", False, 12.0),
    ]


@pytest.mark.long
def test_a_planted_layer_is_found_to_have_decided_a_real_failure(stalled):
    _, judged = stalled
    job = stalled_job()
    found = explain_job(job, max_runs=18, rewinds=64).inevitability
    assert found.by == "waypoint_generator"
    assert 0.0 < found.decided_at <= found.found  # it helps as long as the robots wait
    assert found.found == judged.verdicts[0].violated_at
    assert found == explain_job(job, max_runs=18, rewinds=64).inevitability
