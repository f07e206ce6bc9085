"""Changes to a problem never turn feasibility the wrong way; the checker sees every mutation."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mrta_falsify.core.allocation_problem import Infeasible, OpenTask
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.verification import verify
from tests.stack.allocation_cases import problem

EXACT = Exact(ExactOptions(improvement_steps=0, fewest_lost=False))
INSERTION = Insertion(InsertionOptions())
SEEDS = st.integers(0, 10_000)
FEW = settings(deadline=None, max_examples=40)


def at_the_edge(seed):
    return problem(seed, robots=3, tasks=5, slack=(35, 120))


@FEW
@given(seed=SEEDS, order=st.permutations([0, 1, 2]))
def test_the_order_of_robots_does_not_decide_feasibility(seed, order):
    case = at_the_edge(seed)
    shuffled = dataclasses.replace(case, robots=tuple(case.robots[i] for i in order))
    assert EXACT.allocate(case).status == EXACT.allocate(shuffled).status


@FEW
@given(seed=SEEDS, number=st.integers(0, 4), more=st.integers(1, 100))
def test_a_later_deadline_keeps_a_feasible_problem_feasible(seed, number, more):
    case = at_the_edge(seed)
    tasks = tuple(
        dataclasses.replace(task, deadline=task.deadline + more) if task.number == number else task
        for task in case.tasks
    )
    relaxed = dataclasses.replace(case, tasks=tasks)
    if EXACT.allocate(case).status == "plan":
        assert EXACT.allocate(relaxed).status == "plan"


@FEW
@given(seed=SEEDS, extra=st.integers(0, 11), deadline=st.integers(1, 3000))
def test_one_more_task_never_makes_an_infeasible_problem_feasible(seed, extra, deadline):
    case = at_the_edge(seed)
    new = OpenTask(number=50, start=extra, end=(extra + 1) % 12, arrival=0.0, deadline=deadline)
    more = dataclasses.replace(case, tasks=(*case.tasks, new))
    if EXACT.allocate(case).status == "infeasible":
        assert EXACT.allocate(more).status == "infeasible"


@FEW
@given(seed=SEEDS)
def test_a_far_task_with_time_enough_never_makes_a_feasible_problem_infeasible(seed):
    case = at_the_edge(seed)
    new = OpenTask(number=50, start=0, end=1, arrival=0.0, deadline=100_000.0)
    more = dataclasses.replace(case, tasks=(*case.tasks, new))
    assert EXACT.allocate(case).status == EXACT.allocate(more).status


@FEW
@given(seed=SEEDS)
def test_insertion_never_finds_a_plan_where_none_is_proved_possible(seed):
    case = at_the_edge(seed)
    if INSERTION.allocate(case).status == "plan":
        assert EXACT.allocate(case).status == "plan"


@FEW
@given(seed=SEEDS, seconds=st.integers(1, 500))
def test_shifting_all_times_shifts_the_plan(seed, seconds):
    case = at_the_edge(seed)
    later = dataclasses.replace(
        case,
        now=case.now + seconds,
        tasks=tuple(
            dataclasses.replace(t, arrival=t.arrival + seconds, deadline=t.deadline + seconds)
            for t in case.tasks
        ),
        robots=tuple(dataclasses.replace(p, free_at=p.free_at + seconds) for p in case.robots),
    )
    plans = [INSERTION.allocate(c).itineraries for c in (case, later)]
    moved = tuple(
        tuple(dataclasses.replace(stop, time=stop.time + seconds) for stop in stops)
        for stops in plans[0]
    )
    assert moved == plans[1]


# --- the checker --------------------------------------------------------------------------


def swap_ends(answer, case, r, i):
    """Drop before pickup."""
    stops = list(answer.itineraries[r])
    task = stops[i].task
    j = next(j for j, stop in enumerate(stops) if stop.task == task and j != i)
    stops[i], stops[j] = stops[j], stops[i]
    return stops


def lose_stop(answer, case, r, i):
    stops = list(answer.itineraries[r])
    del stops[i]
    return stops


def repeat_stop(answer, case, r, i):
    stops = list(answer.itineraries[r])
    return [*stops, stops[i]]


def other_room(answer, case, r, i):
    stops = list(answer.itineraries[r])
    room = (stops[i].room + 1) % len(case.travel_times)
    stops[i] = dataclasses.replace(stops[i], room=room)
    return stops


def too_early(answer, case, r, i):
    stops = list(answer.itineraries[r])
    stops[i] = dataclasses.replace(stops[i], time=stops[i].time - 1.0)
    return stops


def unknown_task(answer, case, r, i):
    stops = list(answer.itineraries[r])
    stops[i] = dataclasses.replace(stops[i], task=77)
    return stops


def not_a_time(answer, case, r, i):
    stops = list(answer.itineraries[r])
    stops[i] = dataclasses.replace(stops[i], time=np.nan)
    return stops


@pytest.mark.parametrize(
    "mutate",
    [swap_ends, lose_stop, repeat_stop, other_room, too_early, unknown_task, not_a_time],
    ids=lambda f: f.__name__,
)
@FEW
@given(seed=SEEDS, pick=st.integers(0, 1000))
def test_the_checker_rejects_every_mutated_plan(mutate, seed, pick):
    case = problem(seed, robots=2, tasks=5, slack=(300, 600))
    answer = INSERTION.allocate(case)
    assert verify(answer, case) == ()
    places = [(r, i) for r, stops in enumerate(answer.itineraries) for i in range(len(stops))]
    r, i = places[pick % len(places)]
    plans = list(answer.itineraries)
    plans[r] = tuple(mutate(answer, case, r, i))
    assert verify(dataclasses.replace(answer, itineraries=tuple(plans)), case)


@FEW
@given(seed=SEEDS)
def test_the_checker_rejects_an_overload_and_a_stolen_task(seed):
    case = problem(seed, robots=2, tasks=6, slack=(300, 600))
    answer = INSERTION.allocate(case)
    tight = dataclasses.replace(
        case, robots=tuple(dataclasses.replace(p, capacity=1) for p in case.robots)
    )
    loads = [
        max(np.cumsum([1 if s.action == "pickup" else -1 for s in stops]), default=0)
        for stops in answer.itineraries
    ]
    assert any("at most 1" in str(f) for f in verify(answer, tight)) == (max(loads) > 1)
    assume(all(answer.itineraries))
    stolen = (answer.itineraries[0] + answer.itineraries[1][-2:], answer.itineraries[1])
    assert verify(dataclasses.replace(answer, itineraries=stolen), case)


@FEW
@given(seed=SEEDS)
def test_the_checker_rejects_wrong_lists_and_wrong_proofs(seed):
    case = problem(seed, robots=2, tasks=4, slack=(300, 600))
    answer = INSERTION.allocate(case)
    wrong = [
        dataclasses.replace(answer, late=(0,), reason="no"),
        dataclasses.replace(answer, unserved=(0,), reason="no"),
        dataclasses.replace(answer, infeasible=Infeasible(core=(0,), reason="no")),
        dataclasses.replace(answer, infeasible=Infeasible(core=(9,), reason="no")),
        dataclasses.replace(answer, itineraries=answer.itineraries[:1]),
    ]
    assert all(verify(one, case) for one in wrong)
    late = dataclasses.replace(
        case, tasks=tuple(dataclasses.replace(t, deadline=1.0) for t in case.tasks)
    )
    assert any("not named so" in str(fault) for fault in verify(answer, late))
