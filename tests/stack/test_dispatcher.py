"""The dispatcher against scripted allocators and reports."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.allocation_problem import Allocation, Stop
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.defects import with_defects
from mrta_falsify.core.world import RobotSpec, Room, Task, World
from mrta_falsify.stack.allocation.insertion import Insertion
from mrta_falsify.stack.dispatcher import Dispatcher, DispatcherState, RobotReport

INSERTION = Insertion(Insertion.Options())


def world(*tasks, robots=2):
    rooms = tuple(Room(name=f"room{i}", point=frozen_array([i * 5.0, 0.0])) for i in range(3))
    return World(
        name="line",
        bounds=frozen_array([-1.0, -1.0, 11.0, 1.0]),
        rooms=rooms,
        robots=tuple(
            RobotSpec(name=f"r{i}", pose=frozen_array([i * 5.0, 0.0, 0.0])) for i in range(robots)
        ),
        tasks=tuple(Task(arrival=a, start=s, end=e, deadline=d) for a, s, e, d in tasks),
        travel_times=frozen_array([[0, 10, 20], [10, 0, 10], [20, 10, 0]]),
    )


def report(*, itinerary=(), onboard=(), room=0, ends=0.0, reachable=True):
    return RobotReport(
        itinerary=tuple(itinerary),
        onboard=tuple(onboard),
        room=room,
        first_ends=ends,
        reachable=reachable,
    )


class Fleet:
    """Reports by hand; counts how often they are asked for."""

    def __init__(self, *reports):
        self.reports, self.asked = list(reports), 0

    def __call__(self):
        self.asked += 1
        return self.reports


def kinds(orders):
    return [event.kind for event in orders.events]


def test_a_task_goes_to_the_robot_at_hand_when_it_arrives():
    dispatcher, state = Dispatcher(world((5.0, 1, 2, 99.0)), INSERTION), DispatcherState()
    fleet = Fleet(report(room=0), report(room=1))
    assert not dispatcher.dispatch(state, 0.0, fleet).itineraries
    orders = dispatcher.dispatch(state, 5.0, fleet)
    assert [stop.action for stop in orders.itineraries[1]] == ["pickup", "dropoff"]
    assert orders.itineraries[0] == ()
    assert kinds(orders) == ["assigned", "allocated"]
    assert state.waiting == []


def test_reports_are_only_made_when_there_is_a_reason():
    dispatcher, state = Dispatcher(world((5.0, 1, 2, 99.0)), INSERTION), DispatcherState()
    fleet = Fleet(report(), report())
    for tick in range(100):
        dispatcher.dispatch(state, tick * 0.05, fleet)
    assert fleet.asked == 0


def test_tasks_wait_until_a_robot_can_be_reached():
    dispatcher, state = Dispatcher(world((0.0, 1, 2, 99.0)), INSERTION), DispatcherState()
    away = report(reachable=False)
    assert kinds(dispatcher.dispatch(state, 0.0, Fleet(away, away))) == ["allocated"]
    assert state.waiting == [0]
    assert kinds(dispatcher.dispatch(state, 1.0, Fleet(away, away))) == []
    orders = dispatcher.dispatch(state, 2.0, Fleet(away, report(room=1)))
    assert len(orders.itineraries[1]) == 2
    assert state.waiting == []


def test_a_robot_that_cannot_be_reached_keeps_its_tasks_alone():
    dispatcher = Dispatcher(world((0.0, 1, 2, 99.0), (4.0, 1, 2, 99.0)), INSERTION)
    state = DispatcherState()
    first = dispatcher.dispatch(state, 0.0, Fleet(report(room=0), report(room=1)))
    lost = report(itinerary=first.itineraries[1], room=1, reachable=False)
    orders = dispatcher.dispatch(state, 4.0, Fleet(report(room=0), lost))
    assert {stop.task for stop in orders.itineraries[0]} == {1}
    assert 1 not in orders.itineraries


def test_the_first_stop_is_committed_and_gets_the_time_that_is_to_be_expected():
    dispatcher = Dispatcher(world((0.0, 0, 2, 99.0), (4.0, 1, 2, 99.0), robots=1), INSERTION)
    state = DispatcherState()
    first = dispatcher.dispatch(state, 0.0, Fleet(report(room=0)))
    busy = report(itinerary=first.itineraries[0], room=0, ends=7.0)
    orders = dispatcher.dispatch(state, 4.0, Fleet(busy))
    assert orders.itineraries[0][0] == Stop(task=0, action="pickup", room=0, time=7.0)
    assert [stop.time for stop in orders.itineraries[0]] == [7.0, 17.0, 27.0, 27.0]


def test_a_late_robot_hands_over_what_another_does_better():
    tasks = [(0.0, 0, 1, 40.0), (0.0, 1, 2, 60.0)]
    dispatcher, state = Dispatcher(world(*tasks), INSERTION), DispatcherState()
    away = report(room=1, reachable=False)
    dispatcher.dispatch(state, 0.0, Fleet(report(room=0), away))
    rest = (stop(0, "dropoff", 1), stop(1, "pickup", 1), stop(1, "dropoff", 2))
    late = report(itinerary=rest, onboard=(0,), room=0, ends=60.0)
    orders = dispatcher.dispatch(state, 40.0, Fleet(late, report(room=1)))
    assert {stop.task for stop in orders.itineraries[1]} == {1}
    assert {stop.task for stop in orders.itineraries[0]} == {0}
    assert "robots late" in orders.events[-1].detail


def test_a_late_robot_with_nothing_to_hand_over_is_left_alone():
    dispatcher, state = Dispatcher(world((0.0, 0, 1, 40.0), robots=1), INSERTION), DispatcherState()
    plan = dispatcher.dispatch(state, 0.0, Fleet(report(room=0))).itineraries[0]
    late = Fleet(report(itinerary=plan[1:], onboard=(0,), room=0, ends=90.0))
    assert not dispatcher.dispatch(state, 60.0, late).itineraries


def test_a_missed_deadline_is_reported_once_and_a_delivered_task_never():
    tasks = [(0.0, 0, 1, 10.0), (0.0, 0, 1, 11.0)]
    dispatcher, state = Dispatcher(world(*tasks), INSERTION), DispatcherState()
    fleet = Fleet(report(), report())
    dispatcher.dispatch(state, 0.0, fleet)
    state.deliver(1)
    seen = [dispatcher.dispatch(state, t, fleet).events for t in (9.0, 10.5, 11.5, 30.0)]
    missed = [e.task for events in seen for e in events if e.kind == "deadline-missed"]
    assert missed == [0]


def test_the_memory_holds_open_tasks_only():
    many = [(float(i), 0, 1, i + 50.0) for i in range(500)]
    dispatcher, state = Dispatcher(world(*many), INSERTION), DispatcherState()
    for i in range(500):
        dispatcher.dispatch(state, float(i), Fleet(report(), report()))
        state.deliver(i)
    assert state.delivered == 500
    assert len(state.open) + len(state.waiting) == 0
    assert len(state.due) <= 52


class Scripted:
    """An allocator that says what it was told."""

    def __init__(self, *plans, unserved=()):
        self.answer = Allocation(itineraries=plans, unserved=unserved)

    def allocate(self, problem):
        return self.answer


def stop(task, action, room):
    return Stop(task=task, action=action, room=room, time=9.0)


PICK, DROP = stop(0, "pickup", 1), stop(0, "dropoff", 2)


@pytest.mark.parametrize(
    ("plans", "fault"),
    [
        (((PICK,), ()), "never drops"),
        (((DROP,), ()), "without having been picked up"),
        (((PICK, DROP), (PICK, DROP)), "robots 0 and 1"),
        (((stop(0, "pickup", 0), DROP), ()), "it is in room 1"),
        (((stop(7, "pickup", 1),), ()), "not open"),
        (((PICK, PICK, DROP), ()), "picked up twice"),
        (((PICK, DROP),), "1 itineraries for 2 robots"),
    ],
)
def test_an_answer_that_cannot_be_carried_out_is_refused_and_nothing_is_lost(plans, fault):
    dispatcher = Dispatcher(world((0.0, 1, 2, 99.0)), Scripted(*plans))
    state = DispatcherState()
    orders = dispatcher.dispatch(state, 0.0, Fleet(report(), report()))
    assert not orders.itineraries
    assert kinds(orders) == ["allocation-refused"]
    assert fault in orders.events[0].detail
    assert state.waiting == [0]


def test_a_task_that_the_allocator_forgets_waits():
    dispatcher = Dispatcher(world((0.0, 1, 2, 99.0)), Scripted((), ()))
    state = DispatcherState()
    dispatcher.dispatch(state, 0.0, Fleet(report(), report()))
    assert state.waiting == [0]
    assert np.isfinite(state.look_at)


def test_an_allocator_that_says_nothing_is_refused():
    class Silent:
        def allocate(self, problem):
            return None

    dispatcher, state = Dispatcher(world((0.0, 1, 2, 99.0)), Silent()), DispatcherState()
    orders = dispatcher.dispatch(state, 0.0, Fleet(report(), report()))
    assert "gave NoneType, no plan" in orders.events[0].detail
    assert state.waiting == [0]


def test_times_that_do_not_add_up_are_worked_out_anew():
    dispatcher = Dispatcher(world((0.0, 1, 2, 15.0)), Scripted((PICK, DROP), ()))
    orders = dispatcher.dispatch(DispatcherState(), 0.0, Fleet(report(), report()))
    assert [stop.time for stop in orders.itineraries[0]] == [10.0, 20.0]
    assert "misses its deadline" in orders.events[-1].detail


def test_travel_and_service_are_rounded_up_and_deadlines_down():
    seen = []

    class Curious:
        def allocate(self, problem):
            seen.append(problem)
            return INSERTION.allocate(problem)

    base = world((0.0, 1, 2, 99.9))
    slow = dataclasses.replace(
        base, travel_times=frozen_array([[0, 9.2, 20], [9.2, 0, 9.2], [20, 9.2, 0]])
    )
    Dispatcher(slow, Curious()).dispatch(DispatcherState(), 0.0, Fleet(report(), report()))
    assert seen[0].travel_times.tolist() == [[0, 10, 19], [10, 0, 10], [19, 10, 0]]
    assert seen[0].tasks[0].deadline == 99.0


def test_a_deadline_about_to_be_lost_is_planned_again_at_the_same_look():
    tasks = [(0.0, 0, 1, 400.0), (0.0, 1, 2, 60.0)]
    dispatcher, state = Dispatcher(world(*tasks), INSERTION), DispatcherState()
    away = report(room=1, reachable=False)
    dispatcher.dispatch(state, 0.0, Fleet(report(room=0), away))
    state.replan_at = 1000.0
    plan = (
        Stop(task=0, action="dropoff", room=1, time=36.0),
        Stop(task=1, action="pickup", room=1, time=46.0),
        Stop(task=1, action="dropoff", room=2, time=56.0),
    )
    late = report(itinerary=plan, onboard=(0,), room=0, ends=46.0)
    orders = dispatcher.dispatch(state, 40.0, Fleet(late, report(room=1)))
    assert {stop.task for stop in orders.itineraries[1]} == {1}
    # What cannot be saved is told once and then left alone.
    alone = report(itinerary=plan, onboard=(0,), room=0, ends=56.0)
    lost = dispatcher.dispatch(state, 41.0, Fleet(alone, away)).itineraries[0]
    again = report(itinerary=lost, onboard=(0,), room=0, ends=56.0)
    assert not dispatcher.dispatch(state, 42.0, Fleet(again, away)).itineraries


@pytest.mark.parametrize("defect", ["late_feedback_unsat", "no_plan_when_infeasible"])
def test_planted_defects_give_up_where_the_default_goes_on(defect):
    tasks = [(0.0, 0, 1, 5.0), (30.0, 1, 2, 200.0)]
    for planted in ((), (defect,)):
        dispatcher = with_defects(Dispatcher, planted)(world(*tasks), INSERTION)
        state = DispatcherState()
        first = dispatcher.dispatch(state, 0.0, Fleet(report(room=0), report(room=1)))
        late = report(itinerary=first.itineraries.get(0, ()), room=0, ends=90.0)
        orders = dispatcher.dispatch(state, 30.0, Fleet(late, report(room=1)))
        assert bool(orders.itineraries) == (not planted)
        assert (1 in state.waiting) == bool(planted)
