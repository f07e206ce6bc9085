"""What the allocators decide, beyond the contract of all of them."""

from __future__ import annotations

import dataclasses
import itertools
import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.core.allocation_problem import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.stack.allocation.auction import Auction
from mrta_falsify.stack.allocation.chain import Chain, ChainOptions
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.nearest import Nearest
from mrta_falsify.stack.allocation.objective import objective_value
from mrta_falsify.stack.allocation.stream import Batch, Stream, run_stream
from mrta_falsify.stack.allocation.timing import timed_allocation
from mrta_falsify.stack.allocation.verification import verify
from tests.stack.allocation_cases import floor, problem

TIMES = np.array([[0.0, 10, 20], [10, 0, 10], [20, 10, 0]])
SMRTA = Path(__file__).parents[3] / "shared" / "data" / "smrta"


def ask(tasks, *robots):
    return AllocationProblem(now=0.0, robots=robots, tasks=tuple(tasks), travel_times=TIMES)


def allocate(tasks, *robots):
    return Insertion(InsertionOptions()).allocate(ask(tasks, *robots))


def robot(number=0, room=0, capacity=2, onboard=()):
    return RobotPlan(robot=number, room=room, free_at=0.0, onboard=onboard, capacity=capacity)


def task(number, start, end, deadline=500.0, **more):
    return OpenTask(number=number, start=start, end=end, arrival=0.0, deadline=deadline, **more)


def visits(itinerary):
    return [(stop.task, stop.action) for stop in itinerary]


# --- insertion -----------------------------------------------------------------------------


def test_loads_for_one_room_travel_together_where_there_is_room():
    both = [task(0, 0, 2), task(1, 0, 2)]
    assert allocate(both, robot()).itineraries[0][-1].time == 20.0
    assert allocate(both, robot(capacity=1)).itineraries[0][-1].time == 60.0


def test_the_urgent_task_goes_first():
    answer = allocate([task(0, 0, 1), task(1, 0, 2, deadline=20.0)], robot(capacity=1))
    assert visits(answer.itineraries[0])[:2] == [(1, "pickup"), (1, "dropoff")]
    assert answer.late == ()


def test_what_cannot_be_in_time_is_served_and_named():
    answer = allocate([task(4, 2, 0, deadline=5.0)], robot())
    assert answer.late == (4,)
    assert "4" in answer.reason


def test_a_late_task_spoils_no_other_deadline():
    answer = allocate([task(0, 2, 0, deadline=5.0), task(1, 0, 1, deadline=12.0)], robot())
    assert answer.late == (0,)


def test_what_is_on_board_is_dropped_by_its_robot():
    answer = allocate([task(0, 1, 2)], robot(0, room=2), robot(1, room=1, onboard=(0,)))
    assert visits(answer.itineraries[1]) == [(0, "dropoff")]


def test_a_leg_toward_a_pickup_starts_no_earlier_than_the_task_arrives():
    later = dataclasses.replace(task(0, 1, 2), arrival=100.0)
    stops = allocate([later], robot()).itineraries[0]
    assert [stop.time for stop in stops] == [110.0, 120.0]


def test_improvement_never_makes_the_objective_worse_and_loses_no_deadline():
    for seed in range(5):
        case = problem(seed, robots=4, tasks=14, slack=(150, 400))
        plain = Insertion(InsertionOptions()).allocate(case)
        better = Insertion(InsertionOptions(improvement_steps=150)).allocate(case)
        assert verify(better, case) == ()
        assert len(better.late) <= len(plain.late)
        if plain.late == better.late == ():
            assert (
                objective_value(case, better, "completion")
                <= objective_value(case, plain, "completion") + 1e-6
            )


def test_the_objective_decides_between_few_robots_and_early_ends():
    case = problem(3, robots=6, tasks=8, slack=(800, 900))
    answers = {
        name: Insertion(InsertionOptions(objective=name, improvement_steps=100)).allocate(case)
        for name in ("completion", "makespan", "travel")
    }
    for name, answer in answers.items():
        mine = objective_value(case, answer, name)
        assert all(mine <= objective_value(case, other, name) + 1e-6 for other in answers.values())


# --- exact ---------------------------------------------------------------------------------


def brute_force(case):
    """Whether all deadlines can be met, by trying every route of every split."""
    numbers = [task.number for task in case.tasks]
    tasks = {task.number: task for task in case.tasks}

    def can(plan, mine):
        todo = [(k, "pickup") for k in mine] + [(k, "dropoff") for k in mine]
        for order in itertools.permutations(todo):
            time, room, load = plan.free_at, plan.room, set()
            for k, action in order:
                place = tasks[k].start if action == "pickup" else tasks[k].end
                time += case.travel_times[room, place] + 1.0
                room = place
                if action == "pickup":
                    load.add(k)
                    if len(load) > plan.capacity:
                        break
                elif k not in load or time > tasks[k].deadline:
                    break
                else:
                    load.remove(k)
            else:
                return True
        return False

    known = {}
    for owners in itertools.product(range(len(case.robots)), repeat=len(numbers)):
        fits = True
        for r, plan in enumerate(case.robots):
            mine = tuple(k for k, owner in zip(numbers, owners, strict=True) if owner == r)
            if (r, mine) not in known:
                known[r, mine] = can(plan, mine)
            fits = fits and known[r, mine]
        if fits:
            return True
    return False


def test_exact_agrees_with_trying_everything_on_both_sides_of_the_edge():
    exact = Exact(ExactOptions(improvement_steps=0))
    seen = set()
    for seed in range(16):
        case = problem(seed, robots=2, tasks=3, slack=(25, 110))
        answer = exact.allocate(case)
        assert verify(answer, case) == ()
        assert (answer.status == "plan") == brute_force(case)
        seen.add(answer.status)
    assert seen == {"plan", "infeasible"}


def without(case, number):
    rest = tuple(task for task in case.tasks if task.number != number)
    return dataclasses.replace(case, tasks=rest)


def only(case, numbers):
    return dataclasses.replace(
        case, tasks=tuple(task for task in case.tasks if task.number in numbers)
    )


def test_cores_are_infeasible_and_minimal():
    exact = Exact(ExactOptions(improvement_steps=0))
    sizes = set()
    for seed in range(12):
        case = problem(seed, robots=3, tasks=7, slack=(40, 100))
        proof = exact.allocate(case).infeasible
        if proof is None:
            continue
        core = only(case, proof.core)
        assert exact.allocate(core).status == "infeasible"
        for number in proof.core:
            assert exact.allocate(without(core, number)).status == "plan"
        sizes.add(len(proof.core))
    assert len(sizes) > 1


def test_no_more_deadlines_are_lost_than_must_be():
    exact = Exact(ExactOptions(improvement_steps=0))
    for seed in range(8):
        case = problem(seed, robots=2, tasks=6, slack=(30, 90))
        answer = exact.allocate(case)
        assert verify(answer, case) == ()
        if answer.status == "infeasible":
            assert len(answer.late) == answer.least_lost
            assert len(Insertion(InsertionOptions()).allocate(case).late) >= answer.least_lost


def test_a_proof_of_one_task_says_who_would_be_first_and_when():
    answer = Exact(ExactOptions()).allocate(ask([task(3, 1, 2, deadline=15.0)], robot(7)))
    assert answer.infeasible.core == (3,)
    assert "robot that could be first, 7, is there at 20 s" in answer.reason


@pytest.mark.slow
def test_counting_proofs_are_found_where_clauses_alone_would_take_for_ever():
    # 9 deliveries between two rooms far apart, one each way in time, 8 robots.
    far = np.array([[0.0, 50.0], [50.0, 0.0]])
    robots = tuple(dataclasses.replace(robot(i, capacity=1), room=0) for i in range(8))
    tasks = tuple(task(k, 0, 1, deadline=60.0) for k in range(9))
    case = AllocationProblem(now=0.0, robots=robots, tasks=tasks, travel_times=far)
    answer = Exact(ExactOptions(node_limit=1_000_000)).allocate(case)
    assert answer.infeasible.core == tuple(range(9))
    assert answer.least_lost == 1


def test_a_limit_is_named_and_still_everything_is_served():
    case = problem(2, robots=3, tasks=7, slack=(40, 100))
    answer = Exact(ExactOptions(node_limit=1)).allocate(case)
    assert verify(answer, case) == ()
    assert answer.infeasible is None
    assert "within 1 nodes" in answer.reason


def test_the_chain_answers_like_insertion_where_that_is_enough_and_proves_where_not():
    easy = problem(1, robots=4, tasks=5, slack=(300, 400))
    chain = Chain(ChainOptions())
    assert chain.allocate(easy) == Insertion(InsertionOptions()).allocate(easy)
    hard = problem(1, robots=2, tasks=8, slack=(20, 40))
    answer = chain.allocate(hard)
    assert answer.status == "infeasible"
    assert verify(answer, hard) == ()
    assert "task" in answer.reason


# --- others --------------------------------------------------------------------------------


def test_nearest_decides_without_travel_times():
    case = problem(4, robots=3, tasks=6)
    unknown = dataclasses.replace(case, travel_times=np.zeros_like(case.travel_times))
    plans = [
        [visits(stops) for stops in Nearest(Nearest.Options()).allocate(p).itineraries]
        for p in (case, unknown)
    ]
    assert plans[0] == plans[1]


def test_nearest_goes_by_the_points_of_the_rooms_where_it_knows_them():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [9.0, 0.0]])
    case = dataclasses.replace(ask([task(0, 1, 2)], robot(0, room=2), robot(1)), points=points)
    answer = Nearest(Nearest.Options()).allocate(case)
    assert [len(stops) for stops in answer.itineraries] == [0, 2]


def test_an_auction_gives_the_cheapest_task_away_first():
    answer = Auction(Auction.Options()).allocate(ask([task(0, 2, 0), task(1, 0, 1)], robot()))
    assert visits(answer.itineraries[0])[0] == (1, "pickup")


def test_a_second_solver_agrees_about_what_is_possible():
    from tests.stack.second_opinion import can_be_covered

    seen = set()
    for seed in range(12):
        case = problem(seed, robots=2, tasks=5, slack=(30, 140))
        status = Exact(ExactOptions(improvement_steps=0)).allocate(case).status
        assert can_be_covered(case) == (status == "plan")
        seen.add(status)
    assert seen == {"plan", "infeasible"}


def test_tours_of_the_tsp_solver_are_made_to_fit_the_capacity():
    from mrta_falsify.stack.allocation.tsp import Tsp

    case = problem(5, robots=2, tasks=6, capacity=1, slack=(300, 600))
    answer = Tsp(Tsp.Options()).allocate(case)
    assert verify(answer, case) == ()
    assert answer.unserved == ()


# --- streams and feedback --------------------------------------------------------------------


def batches(seed, count=6, size=4, slack=(150, 300)):
    """Batches 40 s apart on one floor."""
    found = []
    for b in range(count):
        case = problem(seed + b, tasks=size, slack=slack)
        shifted = tuple(
            dataclasses.replace(
                t, number=b * size + t.number, arrival=40.0 * b, deadline=t.deadline + 40.0 * b
            )
            for t in case.tasks
        )
        found.append(Batch(arrival=40.0 * b, tasks=shifted))
    return found


ALLOCATORS = {
    "insertion": Insertion(InsertionOptions()),
    "chain": Chain(ChainOptions()),
    "auction": Auction(Auction.Options()),
    "nearest": Nearest(Nearest.Options()),
}


@pytest.mark.parametrize("commitment", ["free", "keep"])
@pytest.mark.parametrize("name", sorted(ALLOCATORS))
def test_a_stream_of_batches_passes_the_checker(name, commitment):
    stream = Stream(floor(7), [0, 3, 5], 2, ALLOCATORS[name], commitment=commitment, room_for=2)
    outcome = run_stream(stream, batches(7))
    assert outcome.faults == ()
    assert outcome.answer.unserved == ()


@pytest.mark.parametrize("name", ["insertion", "chain"])
def test_what_was_committed_never_changes(name):
    stream = Stream(floor(3), [0, 3], 2, ALLOCATORS[name])
    before = [[], []]
    for batch in batches(3):
        done = stream.advance(batch.arrival)
        assert [stops[: len(old)] for stops, old in zip(done, before, strict=True)] == before
        before = done
        stream.take(batch)


def test_kept_plans_are_only_appended_to():
    stream = Stream(floor(3), [0, 3], 2, ALLOCATORS["insertion"], commitment="keep")
    before = [(), ()]
    for batch in batches(3):
        stream.advance(batch.arrival)
        stream.take(batch)
        now = stream.itineraries()
        assert [stops[: len(old)] for stops, old in zip(now, before, strict=True)] == before
        before = now


@pytest.mark.parametrize("name", ["insertion", "chain"])
@pytest.mark.parametrize("delay", [3.0, 10.0, 60.0])
def test_late_feedback_makes_tasks_late_and_never_the_fleet_infeasible(name, delay):
    stream = Stream(floor(7), [0, 3, 5], 2, ALLOCATORS[name])
    for batch in batches(7):
        done = stream.advance(batch.arrival)
        stream.feedback({r: s[-1].time + delay for r, s in enumerate(done) if s})
        stream.take(batch)
    outcome = stream.outcome()
    assert outcome.faults == ()
    assert outcome.answer.unserved == ()
    if delay < 60.0:
        assert len(outcome.answer.late) < 12


def test_with_loose_deadlines_late_feedback_costs_nothing():
    # The case in which SMrTa for simulation wrongly reports "unsatisfiable".
    stream = Stream(floor(1), [0, 3, 5], 2, ALLOCATORS["insertion"])
    for batch in batches(1, count=4, slack=(5000, 5001)):
        done = stream.advance(batch.arrival)
        stream.feedback({r: s[-1].time + 10.0 for r, s in enumerate(done) if s})
        stream.take(batch)
    assert stream.outcome().answer.status == "plan"


def test_a_fleet_prepared_for_feedback_plans_the_same():
    outcomes = []
    for expects in (False, True):
        stream = Stream(floor(7), [0, 3, 5], 2, ALLOCATORS["insertion"], expects_feedback=expects)
        for batch in batches(7):
            done = stream.advance(batch.arrival)
            stream.feedback({r: s[-1].time + 20.0 for r, s in enumerate(done) if s})
            stream.take(batch)
        outcomes.append(stream.outcome())
    assert outcomes[0] == outcomes[1]


def test_nothing_is_committed_before_time_has_come():
    stream = Stream(TIMES, [0, 1], 2, ALLOCATORS["insertion"])
    stream.take(Batch(arrival=0.0, tasks=(task(0, 1, 2), task(1, 0, 1))))
    planned = stream.itineraries()
    assert stream.advance(0.0) == [[], []]
    done = stream.advance(0.5)
    assert all(done)
    assert stream.itineraries() == planned


def test_a_plan_that_cannot_be_carried_out_is_refused():
    class Forgetful:
        def allocate(self, case):
            stops = [(s,) for s in allocate(case.tasks, *case.robots).itineraries[0][:1]]
            return timed_allocation(case, stops)

    stream = Stream(TIMES, [0], 2, Forgetful())
    with pytest.raises(HarnessError, match="never drops task 0"):
        stream.take(Batch(arrival=0.0, tasks=(task(0, 1, 2),)))


# --- travel times ------------------------------------------------------------------------------


def test_the_shipped_times_of_the_hospital_are_complete_and_obey_the_triangle_rule():
    from scenic_worlds.layouts import load_world
    from simulator_interface.formats.smrta import read_travel_times

    path = Path(str(resources.files("scenic_worlds.layouts"))) / "travel_times/aws_hospital.json"
    table, world = read_travel_times(path), load_world("aws_hospital_day")
    assert json.loads(path.read_text())["rooms"] == [room.name for room in world.rooms]
    assert table.shortened == 0
    ratio = (table.times + np.eye(6)) / (world.travel_times + np.eye(6))
    assert ((ratio > 0.7) & (ratio < 1.4)).all()


def test_time_from_a_room_to_itself_is_dropped_and_counted(tmp_path):
    from simulator_interface.formats.smrta import read_travel_times

    file = tmp_path / "times.json"
    file.write_text(json.dumps({"units": "s", "travel_time": [[5, 10], [10, 0]]}))
    table = read_travel_times(file)
    assert table.times.tolist() == [[0.0, 10.0], [10.0, 0.0]]
    assert table.shortened == 1


# --- SMrTa's own set ---------------------------------------------------------------------------


def smrta_files(kind):
    return sorted((SMRTA / kind).glob("*.json")) if SMRTA.is_dir() else []


@pytest.mark.skipif(not SMRTA.is_dir(), reason="SMrTa's instances are not here")
def test_every_instance_of_smrta_is_solved_and_verified():
    from simulator_interface.formats.smrta import read_case, read_travel_times

    times = read_travel_times(SMRTA / "travel_time_65_rooms.json").times
    for path in smrta_files("single") + smrta_files("incremental"):
        case = read_case(path, rooms=len(times))
        for name in ("insertion", "exact") if path.parent.name == "single" else ("insertion",):
            allocator = Exact(ExactOptions()) if name == "exact" else ALLOCATORS[name]
            stream = Stream(np.array(times), case.rooms, 2, allocator, room_for=200)
            found = [Batch(arrival=a, tasks=t) for a, t in zip(case.arrivals, case.batches)]  # noqa: B905
            outcome = run_stream(stream, found)
            assert outcome.faults == (), path
            assert outcome.answer.status == "plan", path
    assert json.loads((SMRTA / "travel_time_65_rooms.json").read_text())["units"] == "s"


def test_a_task_that_is_served_at_its_deadline_to_the_last_bit_is_not_proved_impossible():
    due = (0.3 + 0.2) + 0.1  # in another order the sum is larger
    asked = AllocationProblem(
        now=0.3,
        robots=(RobotPlan(robot=0, room=0, free_at=0.3, onboard=(), capacity=1),),
        tasks=(task(0, 1, 2, due, pickup_time=0.1), task(1, 1, 2, due + 1e-3, pickup_time=0.1)),
        travel_times=np.array([[0.0, 0.2, 0.2], [0.2, 0.0, 0.0], [0.2, 0.0, 0.0]]),
    )
    alone = dataclasses.replace(asked, tasks=asked.tasks[:1])
    assert Exact(ExactOptions()).allocate(alone).status == "plan"
    assert Exact(ExactOptions()).allocate(asked).infeasible.core == (0, 1)
