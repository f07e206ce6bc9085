"""Without what, and under which schedule, a foreign stack does not fail."""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.analysis.explain import needs_sentences
from mrta_falsify.analysis.explain.absences import absences_of
from mrta_falsify.analysis.explain.explaining import explain_job
from mrta_falsify.analysis.explain.schedules import with_ties_reversed
from mrta_falsify.analysis.explain.whole_runs import fate_in, looking_for
from mrta_falsify.campaigns.finding_files import read_finding, write_finding
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.findings import ChangedRun, Explanation
from mrta_falsify.core.run_result import Vote
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import Furniture, Task, World
from mrta_falsify.lab import Experiment, Lab, RunResult
from mrta_falsify.trial import Job
from tests.external.test_repeats import result, violated

ROOT = Path(__file__).resolve().parents[2]
BOXES = 200


def box(number: int) -> Furniture:
    """A crumb beside the way."""
    x, y = 0.05 + 0.05 * number, 8.2
    outline = np.array([[x, y], [x + 0.02, y], [x + 0.02, y + 0.02], [x, y + 0.02]])
    return Furniture(name=f"box{number}", kind="crumb", polygon=outline)


@pytest.fixture
def crowded(hall):
    """The hall with 200 small things and two tasks that come at once."""
    task = hall.tasks[0]
    other = dataclasses.replace(task, start=task.end, end=task.start)
    return dataclasses.replace(
        hall,
        horizon=6.0,
        furniture=tuple(box(i) for i in range(BOXES)),
        tasks=(dataclasses.replace(task, arrival=0.0), dataclasses.replace(other, arrival=0.0)),
    )


def job_of(world, specification="stack_runs", **bad) -> Job:
    stack = ExternalStack(
        command=(sys.executable, str(Path(__file__).with_name("picky_stack.py"))),
        folder=str(ROOT),
        env={"PYTHONPATH": str(ROOT)},
        params=bad,
        variants={"tolerant": {"robot": "nobody"}},
        branch="never",
    )
    config = StackConfig(engine=Choice("kinematic"), stack=stack)
    return Job(world=world, config=config, specifications=(specification,), early_stop=True)


class ScriptedLab(Lab):
    """Answers changed runs by a rule on their worlds, and keeps what was asked."""

    def __init__(self, rule: Callable[[World], str]) -> None:
        super().__init__()
        self.rule = rule
        self.asked: list[World] = []

    def run(self, experiment: Experiment) -> RunResult:
        self.asked.append(experiment.world)
        fails = self.rule(experiment.world) == "stays"
        verdict = Verdict(spec="stack_runs", robustness=1.0, violated=False)
        return result(violated("stack_runs") if fails else verdict)


def searched(lab: ScriptedLab, world: World, most: int, had=None) -> list[ChangedRun]:
    own = Experiment(world=world, stack=StackConfig(), specs=("stack_runs",))
    return list(absences_of(own, violated("stack_runs"), had or {}, most, lab))


def test_the_one_of_200_things_that_a_failure_needs_is_found_by_halves(crowded):
    def rule(world):
        return "stays" if any(thing.name == "box77" for thing in world.furniture) else "gone"

    lab = ScriptedLab(rule)
    found = searched(lab, crowded, 1000)
    single = [one for one in found if one.fate == "gone" and len(one.things) == 1]
    assert [one.things for one in single] == [("box77",)]
    assert len(lab.asked) == sum(one.fate in ("stays", "gone") for one in found)
    halves = 2 * int(np.ceil(np.log2(BOXES)))
    assert sum(one.group == "furniture" for one in found) <= 1 + halves
    left_out = [thing for one in found if one.fate == "stays" for thing in one.things]
    assert Counter(left_out)["box76"] == 1


def test_things_that_do_not_matter_cost_one_run(crowded):
    found = searched(ScriptedLab(lambda world: "stays"), crowded, 1000)
    groups = Counter(one.group for one in found)
    assert groups["furniture"] == 1
    assert groups["robots"] == len(crowded.robots)
    assert groups["tasks"] == 2


def test_what_there_are_no_runs_for_is_called_untried(crowded):
    lab = ScriptedLab(lambda world: "gone")
    found = searched(lab, crowded, 3)
    assert len(lab.asked) == 3
    assert {one.fate for one in found} == {"gone", "untried"}
    assert sum(one.fate == "gone" for one in found) == 3


def test_a_robot_is_left_out_with_what_it_had_to_do_where_that_leaves_a_task(crowded):
    lab = ScriptedLab(lambda world: "stays")
    name = crowded.robots[0].name
    found = searched(lab, crowded, 1, {name: (1,)})
    assert found[0].change == f"{name} and what it had to do"
    assert [task.start for task in lab.asked[0].tasks] == [crowded.tasks[0].start]
    found = searched(lab, crowded, 1, {name: (0, 1)})
    assert found[0].change == name
    assert len(lab.asked[1].tasks) == 2


def test_only_the_specification_that_failed_ends_a_changed_run(hall):
    own = Experiment(
        world=hall,
        stack=StackConfig(),
        specs=("no_robot_static_contact", "progress{limit: 30}", "stl:always (time < 5)"),
    )
    at = dataclasses.replace(violated("progress"), violated_at=2.0)
    reduced = looking_for(own, at)
    assert reduced.specs == ("progress{limit: 30}",)
    assert reduced.world == hall
    assert looking_for(own, violated("stl:always (time < 5)")).specs == ("stl:always (time < 5)",)
    unknown = looking_for(own, violated("my name"))
    assert unknown.specs == own.specs
    assert not unknown.early_stop


@pytest.mark.parametrize(
    ("verdicts", "fate"),
    [
        ((violated("progress"),), "stays"),
        ((Verdict(spec="progress", robustness=1.0, violated=False),), "gone"),
        ((unjudged("progress", "no goals"),), "unknown"),
        (
            (Verdict(spec="progress", robustness=1.0, violated=False), violated("stack_runs")),
            "unknown",
        ),
        ((), "unknown"),
        ((violated("deadlines"),), "unknown"),
    ],
)
def test_a_run_that_was_not_judged_is_no_answer(verdicts, fate):
    assert fate_in(result(*verdicts), violated("progress")).fate == fate


def test_the_same_specification_violated_in_another_way_is_told_apart():
    one = dataclasses.replace(violated("stack_runs"), evidence={"kind": "crash"})
    other = dataclasses.replace(one, evidence={"kind": "hang"})
    found = fate_in(result(other), one)
    assert found.fate == "otherwise"
    assert "stack_runs/hang" in found.detail


def test_tasks_that_come_together_change_places_and_no_others(hall):
    times = (0.0, 5.0, 0.0, 7.0)
    tasks = tuple(
        Task(arrival=time, start=0, end=1, deadline=100.0 + i) for i, time in enumerate(times)
    )
    world = dataclasses.replace(hall, tasks=tasks)
    assert [task.deadline for task in with_ties_reversed(world).tasks] == [
        102.0,
        101.0,
        100.0,
        103.0,
    ]


def explained(*runs: ChangedRun, copies=(0, 0), **more) -> Explanation:
    return Explanation(
        layer="stack",
        guess="stack",
        reason="",
        changed_at=0.0,
        counterfactuals=(),
        jittered=Vote(failed=copies[0], runs=copies[1]),
        runs=1,
        absences=tuple(run for run in runs if run.group != "schedule"),
        schedules=tuple(run for run in runs if run.group == "schedule"),
        **more,
    )


def test_sentences_name_what_it_needs_and_what_it_does_not():
    def run(group, change, fate, *things, detail=""):
        return ChangedRun(group=group, change=change, fate=fate, things=things, detail=detail)

    found = explained(
        run("furniture", "8 pieces of furniture", "gone", "a", "b"),
        run("furniture", "a", "gone", "a"),
        run("furniture", "b", "stays", "b"),
        run("robots", "robot1", "stays", "robot1"),
        run("robots", "robot2", "unknown", "robot2", detail="the stack failed at 3.0 s"),
        run("tasks", "task3", "untried", "task3"),
        run("schedule", "every command 50 ms later", "stays"),
        run("schedule", "every command 100 ms later", "gone"),
        copies=(1, 8),
    )
    assert needs_sentences(found) == (
        "The failure is gone without a.",
        "The failure stays without b and without robot1.",
        "No answer without robot2: the stack failed at 3.0 s.",
        "Not tried without task3: the runs were used up (--max-runs).",
        "The failure depends on the schedule: it is not there with every command 100 ms later; it "
        "stays with every command 50 ms later.",
        "Most perturbed runs pass, so any change may remove the failure: these sentences say "
        "little.",
    )


def test_a_sentence_says_in_how_many_runs_the_failure_stays():
    people = ChangedRun(
        group="humans",
        things=("a", "b"),
        change="all 2 people",
        fate="gone",
        detail="fails in 1 of 6 runs",
        vote=Vote(failed=1, runs=6),
    )
    (said,) = needs_sentences(explained(people))
    assert said == "The failure is gone without all 2 people (fails in 1 of 6 runs)."


def test_an_explanation_of_an_earlier_version_is_read_and_written_as_it_was(tmp_path):
    old = explained()
    write_finding(tmp_path, old)
    text = (tmp_path / "explain.json").read_text()
    assert "absences" not in text
    assert "schedules" not in text
    assert read_finding(tmp_path, Explanation) == old
    new = explained(ChangedRun(group="robots", things=("a",), change="a", fate="gone"))
    write_finding(tmp_path, new)
    assert read_finding(tmp_path, Explanation) == new


@pytest.mark.long
def test_a_stack_of_which_nothing_is_known_is_explained_by_what_it_fails_without(crowded):
    """It fails with box77 and the last robot there, if the first moved 0.25 m in a second."""
    name = crowded.robots[-1].name
    first = crowded.tasks[0].start
    world = dataclasses.replace(crowded, furniture=crowded.furniture[70:80])
    job = job_of(world, furniture="box77", robot=name, moved=0.25, first=first)
    found = explain_job(job, max_runs=60)
    assert found.runs <= 60
    gone = {one.things for one in found.absences if one.fate == "gone" and len(one.things) == 1}
    assert {("box77",), (name,), ("task0",)} <= gone
    rows = {row.change: row for row in found.rows}
    stack, tolerant = rows["the stack as it is"], rows["stack: its variant tolerant"]
    assert 0 < stack.failed < stack.runs  # in copies the tasks do not come at once
    assert (tolerant.failed, tolerant.runs) == (0, stack.runs)
    by_change = {one.change: one.fate for one in found.schedules}
    assert by_change["every command 50 ms later"] == "stays"
    assert by_change["every command 200 ms later"] == "gone"
    assert by_change["tasks that come at the same time told in reverse order"] == "gone"
    assert found.jittered == Vote(runs=stack.runs, failed=stack.failed)


@pytest.mark.slow
def test_a_stack_that_does_not_fail_again_is_said_to_answer_otherwise(crowded):
    with pytest.raises(InputError, match="does not answer the same again"):
        explain_job(job_of(crowded, robot="nobody"))
