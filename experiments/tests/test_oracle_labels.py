"""Labels by continuation, on scenes whose fate is plain."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from shapely import unary_union
from shapely.geometry import box

from experiments.oracle.comparison import compare
from experiments.oracle.continuing import Fate, Outcome, Run
from experiments.oracle.edges import Edge, FreeDistance, Rerun, draw
from experiments.oracle.figures import lower_bound, report
from experiments.oracle.labels import label
from experiments.oracle.locked import area
from experiments.oracle.membership import groups_of
from experiments.oracle.own_state import groups_by_state, state_at
from experiments.oracle.recurrence import SHORTEST, repeats_itself
from experiments.oracle.rows import append_rows, read_rows
from experiments.oracle.shut_off import is_shut_off
from experiments.oracle.stacks import outside
from experiments.oracle.worlds import KINDS, NOT_COPIED, ROUND, SHIPPED, case, cases
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, Furniture, Task
from mrta_falsify.testing.floors import floor, robot, two_rooms
from mrta_falsify.testing.stacks import BRAKE, IN_TURN, SYMMETRIC, stack

FAR = 1e5  # s, a deadline that never comes


def order(start: int, end: int, arrival: float = 0.2, **more: float) -> Task:
    return Task(arrival=arrival, start=start, end=end, deadline=FAR, **more)


def cut_off(end: float, robots: int = 1):
    """Robots in file, and from the start to ``end`` a cart across their only way."""
    world = two_rooms(box(-1.5, -0.5, 1.5, 0.5), side=2.0, gap=3.0)
    cart = Blockage(name="cart", polygon=rectangle(0.5, 1.0, (0.0, 0.0)), start=0.0, end=end)
    return dataclasses.replace(
        world,
        robots=tuple(robot(i, -2.2 - 0.7 * i, 0.0) for i in range(robots)),
        tasks=tuple(order(0, 1, arrival=0.2 + i) for i in range(robots)),
        events=(cart,),
        horizon=30.0,
    )


def head_on():
    """Two robots at the ends of a lane in single file, each of which wants to the other end."""
    world = two_rooms(box(-2.0, -0.4, 2.0, 0.4), side=0.8, gap=4.0)
    robots = (robot(0, -2.4, 0.0, 0.0), robot(1, 2.4, 0.0, np.pi))
    return dataclasses.replace(world, robots=robots, tasks=(order(0, 1), order(1, 0)), horizon=30.0)


def chain():
    """A root in single file before a cart; one behind wants to its place, the last one to near it.

    The last one is held up by the one before it as well, which only the root holds.
    """
    lane = box(-5.0, -0.4, 3.5, 0.4)
    world = floor(lane, np.array([[3.1, 0.0], [1.1, 0.0], [0.5, 0.0]]))
    cart = Blockage(name="cart", polygon=rectangle(0.4, 0.8, (1.6, 0.0)), start=0.0, end=1e6)
    return dataclasses.replace(
        world,
        robots=tuple(robot(i, x, 0.0) for i, x in enumerate((1.0, -0.2, -1.4))),
        tasks=tuple(order(room, room) for room in range(3)),
        events=(cart,),
        horizon=25.0,
    ), stack(BRAKE, allocator=IN_TURN)


def niches():
    """Three robots in niches beside a corridor in single file, each of which wants the next one."""
    xs = np.array([0.0, 1.6, 3.2])
    parts = [box(-0.4, 0.0, 3.6, 0.8), *(box(x - 0.4, 0.8, x + 0.4, 1.8) for x in xs)]
    points = np.stack([xs, np.full(3, 1.4)], axis=1)
    world = floor(unary_union(parts), points)
    return dataclasses.replace(
        world,
        robots=tuple(robot(i, *points[i], -np.pi / 2) for i in range(3)),
        tasks=tuple(order(i, (i + 1) % 3) for i in range(3)),
        horizon=25.0,
    ), stack(BRAKE, allocator=IN_TURN)


def hall_of_locks():
    """Two robots that cross the same two areas of an open hall, each from its own side."""
    sides = [box(x - 0.8, -1.4, x + 0.8, 1.4) for x in (-2.0, 2.0)]
    ends = np.array([[-4.5, 0.7], [4.5, -0.7], [4.5, 0.7], [-4.5, -0.7]])
    world = floor(box(-6.0, -2.0, 6.0, 2.0), ends)
    return dataclasses.replace(
        world,
        resources=tuple(area(f"area{k}", shape) for k, shape in enumerate(sides)),
        robots=tuple(robot(i, *ends[i], np.pi * i) for i in range(2)),
        tasks=tuple(dataclasses.replace(order(i, 2 + i), robot=f"robot{i + 1}") for i in range(2)),
        horizon=40.0,
    )


def outside_stack(mode):
    random = np.random.default_rng(1)
    return outside(random, "locks", mode=mode, before=0.6, keep=1, patience=1e9)


@pytest.mark.slow
def test_a_robot_that_is_cut_off_for_good_is_a_deadlock_by_itself():
    (found,) = label(cut_off(1e6), stack()).deadlocks
    assert found.members == (0,)
    assert found.victims == ()
    assert not found.is_borderline
    assert found.kind == "shut"
    assert found.stands < 10.0


@pytest.mark.parametrize("end", [20.0, pytest.param(400.0, marks=pytest.mark.slow)])
def test_a_robot_whose_way_opens_again_is_none(end):
    found = label(cut_off(end), stack())
    assert found.deadlocks == ()
    assert not found.is_borderline


@pytest.mark.slow
def test_what_stands_only_until_the_next_task_comes_is_held_and_no_deadlock():
    """An idle robot in the way, which never makes room, leaves when a task of its own arrives."""
    free = unary_union([box(-2.8, -0.4, 2.0, 0.4), box(2.0, -1.5, 5.0, 1.5)])
    world = dataclasses.replace(
        floor(free, np.array([[-2.4, 0.0], [3.5, 1.0], [3.5, -1.0]])),
        robots=(robot(0, -2.4, 0.0), robot(1, 1.0, 0.0)),
        tasks=tuple(
            dataclasses.replace(task, robot=f"robot{i + 1}")
            for i, task in enumerate((order(0, 1), order(2, 2, arrival=25.0)))
        ),
        horizon=40.0,
    )
    found = label(world, outside(np.random.default_rng(1), "lanes"))
    assert found.deadlocks == ()
    (held,) = found.held
    assert (held.robot, held.until) == (0, None)
    assert held.moment < 25.0


@pytest.mark.slow
def test_both_robots_of_a_head_on_pair_are_members():
    (found,) = label(head_on(), stack(BRAKE, allocator=IN_TURN)).deadlocks
    assert found.members == (0, 1)
    assert found.kind == "deadlock"
    assert 0.2 <= found.stands <= 12.0


@pytest.mark.slow
def test_of_a_chain_the_root_is_the_member_and_the_others_are_victims():
    (found,) = label(*chain()).deadlocks
    assert found.members == (0,)
    assert found.victims == (1, 2)


@pytest.mark.slow
def test_who_only_waits_for_a_blocked_pair_is_its_victim():
    """Robot 0 wants out of its niche, robot 2 wants in; robot 1 brakes behind its leader."""
    (found,) = label(*niches()).deadlocks
    assert found.members == (0, 2)
    assert found.victims == (1,)


def test_waiting_for_a_long_service_is_no_deadlock():
    world = two_rooms(box(-1.5, -1.3, 1.5, 1.3), side=3.0, gap=3.0)
    world = dataclasses.replace(
        world,
        robots=(robot(0, 3.0, 0.0, np.pi), robot(1, -3.0, 0.0)),
        tasks=(order(1, 0, pickup_time=300.0), order(0, 1)),
        horizon=30.0,
    )
    run = Run(world, stack(allocator=IN_TURN))
    run.advance(30.0)
    assert not run.count.wants[0]
    run.close()
    assert label(world, stack(allocator=IN_TURN)).deadlocks == ()


@pytest.mark.long
def test_a_pair_that_creeps_is_stuck():
    """Nearer by a millimetre a second is no way to a stop (share 0.5: none gives way)."""
    world = two_rooms(box(-3.0, -0.35, 3.0, 0.35), side=0.7, gap=6.0)
    robots = (robot(0, -3.35, 0.0, 0.0), robot(1, 3.35, 0.0, np.pi))
    world = dataclasses.replace(
        world, robots=robots, tasks=(order(0, 1), order(1, 0)), horizon=40.0
    )
    found = label(world, stack(SYMMETRIC, allocator=IN_TURN)).deadlocks
    assert {i for deadlock in found for i in deadlock.group} == {0, 1}


def test_a_continuation_ends_once_the_poses_repeat_themselves():
    run = Run(cut_off(1e6), stack())
    run.advance(15.0)
    fate = run.fate()
    assert fate.proved
    assert fate.outcomes == (Outcome.STUCK,)
    assert fate.ended < 120.0
    run.close()


@pytest.mark.slow
def test_the_early_end_of_a_continuation_does_not_change_its_outcome():
    fates = []
    for thorough in (False, True):
        run = Run(head_on(), stack(BRAKE, allocator=IN_TURN), thorough=thorough)
        run.advance(20.0)
        fates.append(run.fate(limit=900.0))
        run.close()
    short, whole = fates
    assert short.outcomes == whole.outcomes
    assert short.still_since == whole.still_since
    assert short.ended < 200.0 < 919.0 < whole.ended


def test_small_differences_are_small_and_repeatable():
    run = Run(cut_off(1e6), stack())
    run.advance(2.0)
    plain, again, shifted = (run.fate(shift=k, limit=5.0) for k in (0, 1, 1))
    assert again == shifted
    assert plain.ended == again.ended
    run.close()


# --- parts ------------------------------------------------------------------------------


def test_poses_that_go_on_do_not_repeat_themselves():
    time = np.arange(0.0, 130.0, 0.1)
    still = np.zeros((len(time), 1, 3))
    turning = still.copy()
    turning[:, 0, 2] = (2 * np.pi * time / 5.0) % (2 * np.pi)
    creeping = still.copy()
    creeping[:, 0, 0] = 1e-6 * time
    balance = still.copy()
    balance[:, 0, 0] = 1e-13 * 2.0 ** (time / 12.0)
    assert not repeats_itself(balance, 0.1)
    assert repeats_itself(still, 0.1)
    assert repeats_itself(turning, 0.1)
    assert not repeats_itself(creeping, 0.1)
    assert not repeats_itself(still[: int(SHORTEST / 0.1)], 0.1)


@pytest.mark.parametrize(
    ("holds", "members", "victims"),
    [
        ({0: [1], 1: [0]}, (0, 1), ()),
        ({0: [1], 1: [2], 2: [0]}, (0, 1, 2), ()),
        ({0: [1, 2], 1: [2], 2: []}, (0,), (1, 2)),
        ({0: [1, 2], 1: [0, 2], 2: []}, (0, 1), (2,)),
    ],
    ids=["pair", "ring", "chain", "pair-with-one-behind"],
)
def test_members_hold_each_other_and_none_from_outside_holds_them(holds, members, victims):
    (group,) = groups_of(set(holds), lambda gone: holds[gone[0]] if len(gone) == 1 else [])
    assert group == (members, victims)


def test_robots_that_hold_none_stand_alone():
    groups = groups_of({1, 4}, lambda gone: [])
    assert groups == [((1,), ()), ((4,), ())]


def test_two_against_two_in_single_file_are_all_members():
    """Robots 0 and 2 want one way, 1 and 3 the other: only two that are gone free the others."""

    def freed_without(gone):
        return {(0, 2): [1, 3], (1, 3): [0, 2]}.get(gone, [])

    assert groups_of({0, 1, 2, 3}, freed_without) == [((0, 1, 2, 3), ())]


def test_a_timer_that_may_run_keeps_still_poses_from_being_a_proof():
    still = np.zeros((1300, 1, 3))
    assert repeats_itself(still, 0.1)
    assert not repeats_itself(still, 0.1, clock=100.0)
    assert repeats_itself(np.zeros((1700, 1, 3)), 0.1, clock=100.0)


@pytest.mark.parametrize(
    ("waits", "shut_off", "groups"),
    [
        ({0: ("lock", (1,)), 1: ("lock", (0,)), 2: ("robot", (0,))}, (), [((0, 1), (2,))]),
        ({0: ("lock", (1,)), 1: ("lock", (2,)), 2: ("partner", (0,))}, (), [((0, 1, 2), ())]),
        ({0: ("timer", ()), 1: ("robot", (0,)), 2: ("robot", (1,))}, (), [((0,), (1, 2))]),
        (
            {0: ("no_path", ()), 1: ("robot", (0,)), 2: ("robot", (1,))},
            (0, 1),
            [((0,), ()), ((1,), (2,))],
        ),
    ],
    ids=["pair-with-one-behind", "ring", "timer", "shut-off"],
)
def test_members_of_a_stack_outside_come_from_its_own_state(waits, shut_off, groups):
    assert groups_by_state({0, 1, 2}, waits, shut_off) == groups


def test_the_state_of_a_moment_is_the_last_one_before_it(tmp_path):
    rows = [(0.0, {}), (4.0, {"1": ["lock", 0]}), (9.0, {"0": ["timer"]})]
    path = tmp_path / "state.jsonl"
    path.write_text("".join(json.dumps({"time": t, "stand": s}) + "\n" for t, s in rows))
    assert state_at(path, 8.9) == {1: ("lock", (0,))}
    assert state_at(path, 9.0) == {0: ("timer", ())}
    assert state_at(tmp_path / "none", 9.0) == {}


@pytest.mark.parametrize(("gap", "shut"), [(0.0, True), (0.15, True), (0.4, False)])
def test_a_bed_before_a_door_shuts_a_room_unless_a_body_passes(gap, shut):
    """The bed stands 0.1 m before the wall; ``gap`` of the door is left open beside it."""
    free = unary_union(
        [box(0.0, 0.0, 8.0, 3.0), box(3.0, 2.99, 4.0, 3.2), box(2.0, 3.19, 6.0, 6.0)]
    )
    bed = Furniture(name="bed", kind="bed", movable=True, polygon=rectangle(2.0, 0.9, (1.0, 1.0)))
    world = floor(free, np.array([[7.0, 1.0], [4.0, 5.0]]))
    world = dataclasses.replace(world, furniture=(bed,), robots=(robot(0, 7.0, 1.0),))
    there = (3.0 + gap + 1.0, 2.45, 0.0)
    end = Fate((Outcome.STUCK,), (-1.0,), (0.0,), (0.0,), 100.0, True, furniture=(there,))
    place, goal = world.rooms[0].point, world.rooms[1].point
    assert is_shut_off(world, end, 0, place, goal) is shut


@pytest.mark.slow
def test_robots_that_hold_locks_crosswise_are_members_though_no_removal_frees_them():
    world = hall_of_locks()
    (found,) = label(world, outside_stack("hold")).deadlocks
    assert (found.members, found.victims, found.kind) == ((0, 1), (), "deadlock")
    assert label(world, outside_stack("atomic")).deadlocks == ()


# --- wait edges -------------------------------------------------------------------------


def claimed(robot_name, other, kind):
    edge = {"campaign": "runs/a", "trial": "0001", "at": 9.0, "cause": "barrier"}
    return Edge(robot=robot_name, other=other, kind=kind, together=(), **edge)


def test_edges_are_drawn_by_seed_and_those_to_robots_apart():
    known = [claimed("a", f"b{k}", "robot") for k in range(30)]
    known += [claimed("a", f"wall{k}", "wall") for k in range(5)]
    drawn = draw(known, count=10, others=9, seed=3)
    assert [edge.kind for edge in drawn] == ["robot"] * 10 + ["wall"] * 5
    assert drawn == draw(known[::-1], count=10, others=9, seed=3)
    assert drawn != draw(known, count=10, others=9, seed=4)
    assert len(set(drawn)) == len(drawn)


@pytest.mark.slow
def test_a_robot_that_is_held_up_moves_once_the_other_one_is_gone():
    with Rerun(head_on(), stack(BRAKE, allocator=IN_TURN)) as run:
        run.advance(20.0)
        assert not run.moves(0)
        assert run.moves(0, [1])


def test_the_free_distance_leads_around_walls():
    world = two_rooms(box(-2.0, 0.5, 2.0, 1.3), side=3.0, gap=4.0)
    frame = SimpleNamespace(sensed=SimpleNamespace(time=0.0, furniture_pose=np.zeros((0, 3))))
    to_go = FreeDistance(world, frame, np.array([3.0, -1.0]))
    assert to_go(np.array([3.0, 0.0])) == pytest.approx(1.0, abs=0.1)
    assert 7.0 < to_go(np.array([-3.0, -1.0])) < 8.5  # 6 m as the crow flies


# --- claims against labels --------------------------------------------------------------


def labelled(**changes):
    """Robots a and b hold each other for good, c waits behind them; d is free at 300 s."""
    found = {
        "members": ["a", "b"],
        "victims": ["c"],
        "kind": "deadlock",
        "stands": 20.0,
        "there": 18.0,
    }
    found |= {"moving": False, "borderline": False}
    ways = {"a": [[1.0, None]], "b": [[2.0, 9.0], [12.0, None]], "c": [[3.0, None]]}
    row = {"case": "k/1", "kind": "k", "horizon": 120.0, "deadlocks": [found], "borderline": False}
    row |= {"ways": {**ways, "d": [[5.0, 300.0]]}, "held": []}
    return row | changes


def test_a_claim_of_the_members_is_right_exact_and_late_by_its_delay():
    found = compare(labelled(), {"members": ["b", "a"], "detected_at": 23.0})
    assert found.is_right
    assert found.is_exact
    assert found.is_true
    assert found.delay == 3.0
    assert found.bound == 3600.0


def test_a_claim_before_the_last_member_stands_has_a_negative_delay():
    assert compare(labelled(), {"members": ["a", "b"], "detected_at": 17.0}).delay == -1.0
    assert compare(labelled(), {"members": ["a", "b"], "detected_at": 19.0}).delay == 0.0


def test_a_claim_of_a_victim_is_right_with_wrong_members():
    found = compare(labelled(), {"members": ["c"], "detected_at": 23.0})
    assert found.is_right
    assert not found.is_exact


@pytest.mark.parametrize(
    ("stated", "right", "right_3600"),
    [
        ({"stands_for": 240.0}, True, False),
        ({"stands_for": 290.0}, False, False),
        ({"stands_for": 240.0, "for_good": True}, False, False),
        ({}, False, False),
    ],
)
def test_a_claim_is_judged_at_the_bound_that_it_states(stated, right, right_3600):
    found = compare(labelled(), {"members": ["d"], "detected_at": 30.0, **stated})
    assert (found.is_right, found.is_right_3600) == (right, right_3600)


def test_a_claim_of_a_robot_that_reaches_its_stop_is_wrong_even_if_it_is_stuck_later():
    found = compare(labelled(), {"members": ["b"], "detected_at": 8.0, "stands_for": 60.0})
    assert not found.is_right
    assert found.is_true  # the deadlock of a and b is missed by it


def test_a_robot_that_only_an_arrival_frees_is_held_and_no_deadlock():
    held = [{"robot": "d", "moment": 299.0, "until": None}]
    label_of = labelled(deadlocks=[], held=held)
    found = compare(label_of, {"members": ["d"], "detected_at": 30.0, "for_good": True})
    assert not found.is_right
    assert found.is_held
    assert not found.is_true


def test_a_claim_of_another_kind_is_right_but_of_the_wrong_kind():
    claim = {"members": ["a", "b"], "detected_at": 23.0}
    assert compare(labelled(), claim | {"kind": "deadlock"}).is_kind_right
    assert not compare(labelled(), claim | {"kind": "stuck"}).is_kind_right
    assert compare(labelled(), claim).is_kind_right  # one that states none


def test_what_stands_only_at_the_end_need_not_be_claimed():
    late = labelled()
    late["deadlocks"][0]["stands"] = 110.0
    assert compare(labelled(), None).is_true
    assert not compare(late, None).is_true


def test_bounds_are_exact():
    """Without a failure the bound is the 20th part's n-th root: 0.05 ** (1 / n)."""
    assert lower_bound(60, 60) == pytest.approx(0.05 ** (1 / 60))
    assert lower_bound(0, 5) == 0.0
    assert lower_bound(196, 200) > 0.95 > lower_bound(195, 200)


def test_the_report_counts_claims_and_labels_by_group():
    row = {"case": "k/1", "kind": "k", "group": SHIPPED, "borderline": False, "held": False}
    row |= {"cpu_s": 2.0, "cpu_without_s": 0.5, "contradictions": None}
    hit = row | {"true": True, "claimed": True, "right": True, "right_3600": False, "exact": True}
    hit |= {"kind_right": True, "delay": 6.0}
    early = hit | {"case": "k/2", "delay": -4.0, "right_3600": True}
    missed = hit | {"case": "k/3", "claimed": False, "right": False, "exact": False, "delay": None}
    false = missed | {"case": "k/4", "true": False, "claimed": True, "borderline": True}
    false |= {"right_3600": False, "held": True}
    suspected = false | {"case": "k/5", "group": NOT_COPIED}
    found = report([hit, early, missed, false, suspected])
    assert found["all"]["precision"]["of"] == "2 of 3"
    assert found["all"]["precision_3600"]["of"] == "1 of 3"
    assert found["all"]["recall"]["of"] == "2 of 3"
    assert found["all"]["within_5_s"]["of"] == "1 of 2"
    assert found["all"]["within_5_s_and_not_before"]["of"] == "0 of 2"
    assert (found["all"]["cpu_s"], found["all"]["cpu_without_s"]) == (8.0, 2.0)
    assert found["without_borderline"]["precision"]["of"] == "2 of 2"
    assert found[NOT_COPIED]["precision"]["of"] == "0 of 1"
    assert (found["missed"], found["false"]) == (["k/3"], ["k/4"])
    assert (found["late"], found["early"]) == (["k/1"], ["k/2"])
    assert found["false_but_held"] == ["k/4"]
    assert found["suspected_wrongly"] == ["k/5"]


# --- cases and rows ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_case_depends_on_its_kind_and_seed_only(kind):
    first, again = case(kind, 3), case(kind, 3)
    assert first.world.digest() == again.world.digest()
    assert first.config.digest() == again.config.digest()
    assert case(kind, 4).world.digest() != first.world.digest()


def test_rounds_take_the_kinds_in_turn_and_repeat_no_case():
    names = list(cases(2, ("niches", "slow"), first=100))
    expected = ["niches/100", "niches/101", "slow/100", "niches/102", "niches/103", "slow/101"]
    assert names == expected
    assert len(set(cases(3))) == 3 * sum(ROUND.values())
    assert set(ROUND) <= set(KINDS)


def made_row(name):
    if name == "k/2":
        raise KeyboardInterrupt
    return {"case": name, "cpu_s": 0.0}


def test_an_interrupt_keeps_whole_rows_and_the_next_call_goes_on(tmp_path):
    path = tmp_path / "rows.jsonl"
    with pytest.raises(KeyboardInterrupt):
        append_rows(path, made_row, ["k/1", "k/2", "k/3"], workers=1)
    assert list(read_rows(path)) == ["k/1"]
    with path.open("a") as file:
        file.write('{"case": "k/2", "cp')
    rows = append_rows(path, lambda name: {"case": name, "cpu_s": 9.0}, ["k/1", "k/2"], workers=1)
    assert [json.loads(line)["case"] for line in path.read_text().splitlines()] == ["k/1", "k/2"]
    assert rows["k/1"]["cpu_s"] == 0.0
    assert rows["k/2"]["cpu_s"] == 9.0
