from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from mrta_falsify.analysis.minimize.edits import HORIZON_MARGIN, without
from mrta_falsify.analysis.minimize.first_guess import concerned
from mrta_falsify.analysis.minimize.later_starts import later_starts
from mrta_falsify.analysis.minimize.nominal import NOMINAL, all_nominal
from mrta_falsify.analysis.minimize.reruns import OutOfRunsError
from mrta_falsify.analysis.minimize.search import SmallestSearch
from mrta_falsify.analysis.minimize.sentences import minimal_text
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.directives import Push
from mrta_falsify.core.findings import Minimisation
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.record import PerturbedRuns
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Blockage, CommsOutage, Furniture, Task, World
from mrta_falsify.lab import Course, course_of


def _violated(spec: str = "no_deadlock", at: float = 8.0, **evidence: object) -> Verdict:
    return Verdict(spec=spec, robustness=-1.0, violated=True, violated_at=at, evidence=evidence)


def _waiting(robot: str, other: str) -> dict[str, str]:
    return {"robot": robot, "cause": "barrier", "blocked_by": other, "resource": ""}


@pytest.fixture
def delivered(hall: World, hall_trace: Trace) -> tuple[World, Trace]:
    """``hall`` with a third task, which comes when robot1 has delivered the first at 10 s."""
    late = Task(arrival=10.0, start=0, end=1, deadline=200.0)
    return dataclasses.replace(hall, tasks=(hall.tasks[0], late)), hall_trace


def test_a_course_says_who_had_what_and_where_it_was_delivered(hall, hall_trace):
    course = course_of(_violated(), hall_trace, hall)
    assert course.found == 8.0
    assert course.had == {"robot1": (0,), "robot2": ()}
    (start,) = course.delivered["robot1"]
    assert start.time == pytest.approx(10.0)
    assert start.pose[:2] == pytest.approx(hall.robots[1].pose[:2])


def test_the_fleet_is_at_rest_when_all_known_tasks_are_delivered(delivered, hall, hall_trace):
    world, trace = delivered
    (rest,) = course_of(_violated(), trace, world).rests
    assert [start.time for start in rest] == pytest.approx([10.0, 10.0])
    assert course_of(_violated(), hall_trace, hall).rests == ()


def test_the_first_guess_keeps_what_the_cycle_names_and_what_stood_near(hall, hall_trace):
    far = Furniture(name="far", kind="chair", polygon=rectangle(0.4, 0.4, (11.0, 1.0)))
    world = dataclasses.replace(hall, furniture=(*hall.furniture, far))
    verdict = _violated(cycle=[_waiting("robot1", "wall")])
    guess = concerned(world, verdict, hall_trace)
    assert [robot.name for robot in guess.robots] == ["robot1"]
    assert guess.tasks == hall.tasks[:1]
    assert [item.name for item in guess.furniture] == ["table"]
    assert guess.humans == ()
    assert guess.horizon == 8.0 + HORIZON_MARGIN
    wide = concerned(world, verdict, hall_trace, wide=True)
    assert len(wide.robots) == 2
    assert len(wide.tasks) == 2


def test_the_guess_for_a_late_task_keeps_the_robot_that_had_it(hall, hall_trace):
    verdict = dataclasses.replace(_violated("deadlines"), who=("task0",))
    guess = concerned(hall, verdict, hall_trace)
    assert [robot.name for robot in guess.robots] == ["robot1"]


def test_a_guess_without_anything_to_do_is_none(hall, hall_trace):
    verdict = _violated(cycle=[_waiting("robot2", "robot2")])
    assert concerned(hall, verdict, hall_trace) is None


def test_a_failure_before_any_task_keeps_one_since_a_world_without_any_is_none(hall, hall_trace):
    tasks = tuple(dataclasses.replace(task, arrival=50.0) for task in hall.tasks)
    world, tried = dataclasses.replace(hall, tasks=tasks), []
    reruns = SimpleNamespace(first_failing=tried.extend)
    verdict = _violated()
    SmallestSearch(world, course_of(verdict, hall_trace, world), reruns).begin(verdict, hall_trace)
    assert tried[-1].world.tasks == tasks[:1]
    assert all(smaller.world.tasks for smaller in tried)


def test_furniture_that_someone_pushes_cannot_go_before_them(hall):
    cart = dataclasses.replace(hall.furniture[0], name="cart", movable=True)
    push = Push(furniture="cart", point=frozen_array([3.0, 6.5]))
    pusher = dataclasses.replace(hall.humans[0], directives=(push,))
    world = dataclasses.replace(hall, furniture=(cart,), humans=(pusher,))
    assert without(world, "furniture", [0]) is None
    assert without(without(world, "humans", [0]), "furniture", [0]).furniture == ()


def test_a_robot_goes_with_its_tasks_and_out_of_its_outages(hall):
    outages = (
        CommsOutage(name="its", robots=("robot1",), start=0.0, end=9.0),
        CommsOutage(name="both", robots=("robot1", "robot2"), start=0.0, end=9.0),
        CommsOutage(name="all", robots=(), start=0.0, end=9.0),
    )
    world = dataclasses.replace(hall, events=outages)
    smaller = without(world, "robots", [0], had=[1])
    assert [robot.name for robot in smaller.robots] == ["robot2"]
    assert smaller.tasks == hall.tasks[:1]
    assert [(e.name, e.robots) for e in smaller.events] == [("both", ("robot2",)), ("all", ())]


@pytest.mark.parametrize("group", ["robots", "tasks"])
def test_the_last_robots_and_tasks_stay(hall, group):
    assert without(hall, group, [0, 1]) is None


def test_time_before_the_last_rest_is_cut_off(delivered):
    world, trace = delivered
    bed = Blockage(name="bed", polygon=rectangle(1, 1, (3.0, 5.0)), start=4.0, end=30.0)
    world = dataclasses.replace(world, humans=(), events=(bed,))
    changed = dict(later_starts(world, course_of(_violated(at=20.0), trace, world)))
    later = changed["the first 10 s"]
    assert [(task.arrival, task.deadline) for task in later.tasks] == [(0.0, 190.0)]
    assert later.robots[0].pose == pytest.approx(trace.columns["pose"][-1, 0])
    assert (later.events[0].start, later.events[0].end) == (0.0, 20.0)
    assert later.horizon == world.horizon - 10.0


def test_nothing_is_cut_off_before_people_who_walk(delivered):
    world, trace = delivered
    words = [what for what, _ in later_starts(world, course_of(_violated(), trace, world))]
    assert not any(what.startswith("the first") for what in words)


def test_a_robot_may_begin_where_it_had_delivered_something(delivered):
    world, trace = delivered
    course = course_of(_violated(at=20.0), trace, world)
    course = dataclasses.replace(course, had={"robot1": (0, 1), "robot2": ()})
    changed = dict(later_starts(world, course))
    begun = changed["what robot1 delivered before 10 s"]
    assert [task.arrival for task in begun.tasks] == [10.0]
    assert begun.robots[0].pose == pytest.approx(trace.columns["pose"][-1, 0])
    assert np.array_equal(begun.robots[1].pose, world.robots[1].pose)


def test_values_that_are_nominal_stay_as_they_are(hall):
    calm = all_nominal(hall)
    assert all(change.apply(calm).digest() == calm.digest() for change in NOMINAL)


class _Asked:
    """Says of each world whether it fails, by a rule, and counts what it was asked."""

    def __init__(self, fails, robust=True) -> None:
        self._fails, self._robust = fails, robust
        self.asked: set[str] = set()

    def first_failing(self, worlds):
        for smaller in worlds:
            self.asked.add(smaller.world.digest())
            if self._fails(smaller.world):
                return smaller, Course(found=8.0, had={}, delivered={}, rests=())
        return None

    def is_robust(self, world) -> bool:
        return self._robust

    def knows(self, world) -> bool:
        return world.digest() in self.asked


def _needs_each_other(world: World) -> bool:
    """Whether a world fails in which one chair without the other makes a failure go away."""
    chairs = {item.name for item in world.furniture if item.name.startswith("chair")}
    is_whole = len(world.robots) == len(world.tasks) == 2
    return is_whole and len(chairs) != 1 and len(world.furniture) > len(chairs)


@pytest.fixture
def two_chairs(hall: World) -> World:
    pieces = [
        Furniture(name=name, kind="chair", polygon=rectangle(0.4, 0.4, (11.0, 1.0 + k)))
        for k, name in enumerate(("chair_0", "desk", "chair_1"))
    ]
    return dataclasses.replace(hall, furniture=tuple(pieces), humans=())


def test_two_things_that_need_each_other_go_together(two_chairs):
    reruns = _Asked(_needs_each_other)
    course = Course(found=8.0, had={}, delivered={}, rests=())
    search = SmallestSearch(two_chairs, course, reruns)
    search.finish()
    assert search.one_minimal
    assert [item.name for item in search.world.furniture] == ["desk"]
    assert search.count_pairs() == (10, 10)


def test_a_pair_stays_without_which_few_perturbed_runs_fail(two_chairs):
    reruns = _Asked(_needs_each_other, robust=False)
    course = Course(found=8.0, had={}, delivered={}, rests=())
    search = SmallestSearch(two_chairs, course, reruns)
    search.finish()
    assert search.one_minimal
    assert len(search.world.furniture) == 3
    assert len(search.unsure) == 1
    assert search.count_pairs() == (21, 21)


def test_a_pair_that_the_runs_do_not_suffice_to_vote_on_counts_as_untried(two_chairs):
    class OutOfRuns(_Asked):
        def is_robust(self, world):
            raise OutOfRunsError

    course = Course(found=8.0, had={}, delivered={}, rests=())
    search = SmallestSearch(two_chairs, course, OutOfRuns(_needs_each_other))
    with pytest.raises(OutOfRunsError):
        search.finish()
    pairs, tried = search.count_pairs()
    assert pairs == 21
    known = [way.pair for way in search._ways() if way.pair < tried + 1]
    assert tried == len(set(known)) - 1  # the one whose vote is pending is not among them


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"one_minimal": False}, "out of runs (--max-runs): it may get smaller"),
        ({"pairs": 66, "pairs_tried": 66}, "no single thing and none of 66 pairs can go"),
        ({"pairs": 66, "pairs_tried": 9}, "nor any of the 9 of 66 pairs that were tried"),
        ({"pairs": 6, "pairs_tried": 6, "pairs_unsure": 1}, "without 1 pair the run itself fails"),
        (
            {"jittered": PerturbedRuns(runs=10, failed=9)},
            "fails in 9 of 10 perturbed runs (95% interval 0.56 to 0.99)",
        ),
        ({"jittered": PerturbedRuns(runs=10, failed=3)}, "a knife edge"),
    ],
)
def test_what_was_tried_is_told_exactly(more, told):
    found = Minimisation(
        **{
            "signature": "no_deadlock/2:barrier>barrier/doorway",
            "removed": (),
            "runs": 90,
            "one_minimal": True,
            "counts": {},
            "world_digest": "",
            "trace_digest": "",
            "verdicts": (),
            **more,
        }
    )
    assert told in minimal_text(found)
