"""Rewinding finds when a failure was decided; runs are scripted but for the last tests."""

from __future__ import annotations

import contextlib
import dataclasses

import pytest

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.findings import Counterfactual
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.trial import Job
from mrta_falsify.verbs.explain import decided_sentences, rewinding
from mrta_falsify.verbs.explain.changes import Change
from mrta_falsify.verbs.explain.continuing import Failure
from mrta_falsify.verbs.explain.explaining import explain_job
from mrta_falsify.verbs.explain.rewinding import Branch, RewoundCopy, branches_of, rewind
from mrta_falsify.verbs.explain.run_count import RunCount
from tests.reports.planted import BROKEN
from tests.scenes.ward import ward_layout

FOUND = 40.0  # s
VERDICT = Verdict(spec="no_deadlock", robustness=-1.0, violated=True, violated_at=FOUND)
FAILURE = Failure(verdict=VERDICT, found=FOUND, stops={})
PLANNER = Branch(replaced="layer", name="planner", text="another planner")
QUEUES = Branch(replaced="layer", name="queue_policy", text="another queue policy")


@dataclasses.dataclass
class _Episode:
    can_copy: bool = True
    can_nudge: bool = True


@dataclasses.dataclass
class _Running:
    """As much of a run as rewinding uses: time, which goes forward; copies go on alone."""

    time: float
    episode: _Episode

    def at(self, time):
        assert time >= self.time, "a run cannot go back"
        self.time = time
        return self

    def in_a_copy(self, run, kind):
        del kind
        time = self.time
        answer = run()
        self.time = time
        return answer


@pytest.fixture
def scripted(monkeypatch):
    """Rewinds a run in which copies fail as a script says."""

    def rewound(
        fails,
        *branches,
        most=400,
        episode=None,
        journal=None,
        told=None,
        config=None,
        begun=None,
    ):
        @contextlib.contextmanager
        def run_until(job, failure, time):
            del job, failure
            (begun if begun is not None else []).append(time)
            yield _Running(time, episode or _Episode())

        def continued(running, failure, branch, number):
            del failure
            (told if told is not None else []).append((branch.name, running.time, number))
            failed = fails(branch.name, running.time, number)
            return RewoundCopy(failed=bool(failed), answered=failed is not None)

        monkeypatch.setattr(rewinding, "run_until", run_until)
        monkeypatch.setattr(rewinding, "_continued", continued)
        config = config or StackConfig()
        job = Job(world=ward_layout(rooms=2), config=config, specifications=("no_deadlock",))
        count = RunCount(most, most, lambda done, total: None)
        journal = journal or RunJournal(RewoundCopy, None)
        return rewind(job, FAILURE, branches, count, journal)

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
    first, *_ = decided_sentences(found)
    assert first == f"It was decided at {found.decided_at:.1f} s, by the queue policy."


def test_the_time_when_chance_alone_decided_it_is_found(scripted):
    turns = {"": 20.0, "planner": 20.0}
    found = scripted(lambda name, time, number: time >= turns[name] or number % 4 == 0, PLANNER)
    assert found.by == ""
    assert 20.0 <= found.decided_at <= 20.5
    assert "by no single layer" in decided_sentences(found)[0]


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
    assert found.left_out == "another queue policy: the copies were used up (--rewinds)"
    assert scripted(lambda name, time, number: True, most=2) is None


def test_copies_in_the_journal_are_not_run_again_and_give_the_same(scripted):
    journal, told, again = RunJournal(RewoundCopy, None), [], []

    def fails(name, time, number):
        return time >= 31.0 * bool(name)

    peace = scripted(fails, PLANNER, journal=journal, told=told, most=100)
    kept = list(journal.answers.items())
    half = RunJournal(RewoundCopy, None)
    half.answers = dict(kept[: len(kept) // 2])
    assert scripted(fails, PLANNER, journal=half, told=again, most=100) == peace
    assert again == told[len(kept) // 2 :]


def test_what_cannot_be_judged_widens_the_interval(scripted):
    found = scripted(lambda name, time, number: None if number == 1 else True)
    assert found.curves[0].points[0].chance.undecided == 1
    found = scripted(lambda name, time, number: None)
    assert found.decided_at is None
    assert decided_sentences(found) == ()


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


def test_one_run_goes_forward_while_times_are_halved(scripted):
    begun = []
    scripted(lambda name, time, number: time >= 31.0 * bool(name), PLANNER, begun=begun)
    assert len(begun) == 2  # for the stack as it is, and for what is changed


def test_beside_a_shipped_layer_in_place_of_another_the_others_are_looked_at_less_closely(scripted):
    shipped = dataclasses.replace(PLANNER, restores=True)
    found = scripted(lambda name, time, number: time >= 31.0 * bool(name), shipped, QUEUES)
    _, planner, queues = found.curves
    assert planner.lost_from - planner.open_until <= 0.5
    assert 0.5 < queues.lost_from - queues.open_until <= 2.0


@pytest.mark.parametrize(
    ("episode", "reason"),
    [
        (_Episode(can_copy=False), "the whole run: the stack cannot be copied while it runs"),
        (_Episode(can_nudge=False), "the whole run: the engine bullet cannot move robots a little"),
    ],
)
def test_what_cannot_be_rewound_is_said(scripted, episode, reason):
    found = scripted(lambda name, time, number: True, PLANNER, episode=episode)
    assert found.left_out == reason
    assert found.decided_at is None
    assert decided_sentences(found) == (f"Not rewound: {reason}.",)


def test_layers_that_removed_the_failure_are_replaced_and_shipped_ones_from_the_start():
    changes = [
        Change(layer=layer, text=f"another {layer}", config=StackConfig(), restores=restores)
        for layer, restores in (("queue_policy", False), ("planner", False), ("controller", True))
    ]
    found = [
        Counterfactual(layer=c.layer, change=c.text, failure_gone=c.layer == "planner")
        for c in changes
    ]
    job = Job(world=ward_layout(rooms=2), config=StackConfig())
    chosen = branches_of(job, VERDICT, changes, found, 12.0)
    assert [(b.name, b.restores, b.since) for b in chosen] == [
        ("controller", True, 0.0),
        ("planner", False, 12.0),
    ]


@pytest.mark.slow
def test_a_planted_layer_is_found_to_have_decided_a_real_failure(stalled):
    world, judged = stalled
    job = Job(world=world, config=BROKEN, early_stop=True, specifications=("no_deadlock",))
    found = explain_job(job, max_runs=3, rewinds=64).inevitability
    assert found.by == "waypoint_generator"
    assert 0.0 < found.decided_at <= found.found  # it helps as long as the robots wait
    assert found.found == judged.verdicts[0].violated_at
    assert found == explain_job(job, max_runs=3, rewinds=64).inevitability
