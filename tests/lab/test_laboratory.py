"""The lab runs each experiment once, in order, and shares what comes before an edit."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.campaigns.code_digest import known_code_digest
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.lab import Edit, Experiment, Lab, RunResult, Vote, laboratory


@pytest.fixture
def experiment(hall):
    world = dataclasses.replace(hall, horizon=3.0)
    stack = StackConfig(engine=Choice("kinematic"))
    return Experiment(world=world, stack=stack, specs=("no_robot_robot_contact", "deadlines"))


@pytest.fixture
def scripted(monkeypatch):
    """Runs fail where their perturbation is among some; says what was run together."""

    def lab(*failing, journal=None, on_run=lambda done, expected: None):
        groups = []

        def run_group(group, draw=None):
            groups.append([one.perturbation for one in group])
            return [
                RunResult(
                    status="judged", rank="primary" if one.perturbation in failing else "none"
                )
                for one in group
            ]

        monkeypatch.setattr(laboratory, "run_group", run_group)
        return Lab(journal, on_run=on_run), groups

    return lab


def test_a_vote_ends_once_the_rest_cannot_change_it(scripted, experiment):
    lab, groups = scripted(1, 2, 3)
    assert lab.vote(experiment, 5) == Vote(runs=3, failed=3)
    assert groups == [[1], [2], [3]]
    lab, _ = scripted(2)
    assert lab.vote(experiment, 5) == Vote(runs=4, failed=1)


def test_a_finished_run_is_not_run_again_and_counts(scripted, experiment, tmp_path):
    told = []
    path = tmp_path / "journal.jsonl"
    lab, groups = scripted(1, journal=path)
    (first,) = lab.map([dataclasses.replace(experiment, perturbation=1)])
    again, more = scripted(journal=path, on_run=lambda done, expected: told.append(done))
    found = list(
        again.map(dataclasses.replace(experiment, perturbation=number) for number in (2, 1))
    )
    assert [result.failed for result in found] == [False, True]
    assert found[1] == first
    assert (groups, more, len(told)) == ([[1]], [[2]], 2)


def test_runs_that_share_their_past_are_run_together_by_the_time_of_their_edit(
    scripted, experiment
):
    lab, groups = scripted()
    edits = [(Edit(at=2.0),), (Edit(at=1.0, without=(0,)),)]
    asked = [
        dataclasses.replace(experiment, perturbation=number, edits=edit)
        for number in (1, 2)
        for edit in edits
    ]
    assert len(list(lab.map(asked))) == 4
    assert groups == [[1, 1], [2, 2]]


@pytest.mark.slow
def test_a_fork_without_a_change_is_the_run_itself_and_one_with_a_change_is_not(experiment):
    lab = Lab()
    whole, same, other = lab.map(
        [
            dataclasses.replace(experiment, edits=edits)
            for edits in ((Edit(at=0.0),), (Edit(at=1.0),), (Edit(at=1.0, nudge=1),))
        ]
    )
    assert whole.status == "judged"
    assert whole.trace == same.trace != other.trace


def test_a_run_that_a_deadline_decides_ends_once_a_task_is_late(experiment):
    tasks = tuple(
        dataclasses.replace(task, arrival=0.0, deadline=1.0) for task in experiment.world.tasks
    )
    world = dataclasses.replace(experiment.world, tasks=tasks)
    late = dataclasses.replace(
        experiment, world=world, then=("deadlines",), until_delivered=(0,), edits=(Edit(at=0.0),)
    )
    whole = Lab().run(late)
    ended = Lab().run(dataclasses.replace(late, ends_late=True))
    assert whole.sim_time == pytest.approx(3.0)
    assert 1.0 < ended.sim_time < 2.0
    assert [v.spec for v in ended.verdicts if v.violated] == ["deadlines"]


def test_the_run_itself_can_be_looked_at(experiment, tmp_path):
    def write(world, judged):
        (tmp_path / "seen").write_text(judged.outcome.trace.digest)

    forked = dataclasses.replace(experiment, edits=(Edit(at=1.0),))
    result = Lab().watch(forked, write)
    assert (tmp_path / "seen").read_text() == result.trace


def outside(folder, *command: str, **more) -> StackConfig:
    stack = ExternalStack(command=command, folder=str(folder), **more)
    return StackConfig(engine=Choice("kinematic"), stack=stack)


def test_a_stack_outside_is_the_same_only_as_long_as_its_files_are(tmp_path):
    (tmp_path / "stack.py").write_text("one")
    (tmp_path / "built.so").write_text("one")
    stack = outside(tmp_path, "python", "stack.py")
    first = known_code_digest([stack])
    assert first == known_code_digest([stack])
    (tmp_path / "built.so").write_text("other")  # it may load whatever lies beside it
    assert known_code_digest([stack]) not in (first, None)
    assert known_code_digest([outside(tmp_path, "my-stack", "--fast")]) is None
    assert known_code_digest([outside(tmp_path, connect="127.0.0.1:9000")]) is None


def test_runs_of_a_stack_whose_files_are_not_known_are_not_kept_for_another_call(
    scripted, experiment, tmp_path
):
    path = tmp_path / "journal.jsonl"
    unknown = dataclasses.replace(experiment, stack=outside(tmp_path, connect="127.0.0.1:9000"))
    lab, groups = scripted(journal=path)
    for _ in range(2):
        lab.run(unknown)
    assert groups == [[0]]
    again, more = scripted(journal=path)
    again.run(unknown)
    assert more == [[0]]


def test_a_repetition_is_run_again(scripted, experiment):
    lab, groups = scripted()
    results = lab.map(dataclasses.replace(experiment, repeat=number) for number in (0, 1, 1))
    assert len(list(results)) == 3
    assert len(groups) == 2


@pytest.mark.parametrize("status", ["impossible", "timeout", "error"])
def test_what_was_not_judged_is_run_again_by_the_next_call(
    monkeypatch, experiment, tmp_path, status
):
    """A stack may start the next time, and the next call may have another time limit."""
    statuses = [status, "judged"]

    def run_group(group, draw=None):
        return [RunResult(status=statuses.pop(0)) for _ in group]

    monkeypatch.setattr(laboratory, "run_group", run_group)
    path = tmp_path / "journal.jsonl"
    assert Lab(path).run(experiment).status == status
    assert Lab(path).run(experiment).status == "judged"
    assert Lab(path).run(experiment).status == "judged"
    assert statuses == []
