"""Labels by continuation, on scenes whose fate is plain."""

import dataclasses
import json

import numpy as np
import pytest
from shapely import unary_union
from shapely.geometry import box

from benchmarks.oracle.comparison import compare
from benchmarks.oracle.continuing import Outcome, Run
from benchmarks.oracle.figures import lower_bound, report
from benchmarks.oracle.floors import floor, robot, two_rooms
from benchmarks.oracle.labels import label
from benchmarks.oracle.membership import groups_of
from benchmarks.oracle.recurrence import SHORTEST, repeats_itself
from benchmarks.oracle.rows import append_rows, read_rows
from benchmarks.oracle.stacks import BRAKE, IN_TURN, SYMMETRIC, stack
from benchmarks.oracle.worlds import KINDS, SAMPLED, WEIGHTS, case, cases
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, Task

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


@pytest.mark.slow
def test_a_robot_that_is_cut_off_for_good_is_a_deadlock_by_itself():
    (found,) = label(cut_off(1e6), stack()).deadlocks
    assert found.members == (0,)
    assert found.victims == ()
    assert not found.is_borderline
    assert found.onset < 10.0


@pytest.mark.parametrize("end", [20.0, pytest.param(400.0, marks=pytest.mark.slow)])
def test_a_robot_whose_way_opens_again_is_none(end):
    found = label(cut_off(end), stack())
    assert found.deadlocks == ()
    assert not found.is_borderline


@pytest.mark.slow
def test_what_stands_only_until_the_next_task_comes_is_seen_before_it_comes():
    """An idle robot in the way leaves when a task of its own arrives."""
    world = two_rooms(box(-2.0, -0.4, 2.0, 0.4), side=0.8, gap=4.0)
    world = dataclasses.replace(
        world,
        robots=(robot(0, -2.4, 0.0), robot(1, 1.0, 0.0)),
        tasks=(order(0, 1), order(1, 1, arrival=25.0)),
        lanes=(),
        horizon=30.0,
    )
    found = label(world, stack(allocator=IN_TURN)).deadlocks
    assert found
    assert found[0].members == (0,)
    assert found[0].moment < 25.0


@pytest.mark.slow
def test_both_robots_of_a_head_on_pair_are_members():
    (found,) = label(head_on(), stack(BRAKE, allocator=IN_TURN)).deadlocks
    assert found.members == (0, 1)
    assert 0.2 <= found.onset <= 12.0


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


# --- claims against labels --------------------------------------------------------------


def labelled(**changes):
    found = {"members": ["a", "b"], "victims": ["c"], "onset": 20.0, "sealed": 19.0}
    found |= {"moving": False, "borderline": False, "moment": 100.0} | changes
    return {"case": "k/1", "kind": "k", "horizon": 120.0, "deadlocks": [found], "borderline": False}


def test_a_claim_of_the_members_is_exact_and_its_delay_counts_from_the_onset():
    found = compare(labelled(), {"members": ["b", "a"], "detected_at": 23.0})
    assert found.is_hit
    assert found.is_exact
    assert (found.delay, found.delay_sealed) == (3.0, 4.0)


def test_a_claim_of_a_victim_is_a_hit_with_wrong_members():
    found = compare(labelled(), {"members": ["c"], "detected_at": 23.0})
    assert found.is_hit
    assert not found.is_exact


def test_a_claim_while_small_differences_let_a_member_through_is_early():
    assert compare(labelled(), {"members": ["a", "b"], "detected_at": 17.0}).is_early
    assert not compare(labelled(), {"members": ["a", "b"], "detected_at": 18.5}).is_early


def test_a_claim_where_the_label_knows_no_deadlock_is_no_hit():
    none = labelled() | {"deadlocks": []}
    found = compare(none, {"members": ["a"], "detected_at": 23.0})
    assert not found.is_hit
    assert not found.is_true


def test_what_stands_only_at_the_end_need_not_be_claimed():
    assert compare(labelled(), None).is_true
    assert not compare(labelled(onset=110.0), None).is_true


def test_bounds_are_exact():
    """Without a failure the bound is the 20th part's n-th root: 0.05 ** (1 / n)."""
    assert lower_bound(60, 60) == pytest.approx(0.05 ** (1 / 60))
    assert lower_bound(0, 5) == 0.0
    assert lower_bound(196, 200) > 0.95 > lower_bound(195, 200)


def test_the_report_counts_claims_and_labels():
    row = {"case": "k/1", "kind": "k", "cpu_s": 1.0, "early": False, "upheld": None}
    hit = row | {"true": True, "claimed": True, "hit": True, "exact": True, "borderline": False}
    hit |= {"delay": 6.0, "delay_sealed": None}
    missed = hit | {"case": "k/2", "claimed": False, "hit": False, "exact": False, "delay": None}
    false = missed | {"case": "k/3", "true": False, "claimed": True, "borderline": True}
    early = hit | {"case": "k/4", "early": True, "upheld": False}
    found = report([hit, missed, false, early])
    assert found["all"]["precision"]["of"] == "1 of 3"
    assert found["all"]["recall"]["of"] == "1 of 3"
    assert found["without_borderline"]["precision"]["of"] == "1 of 2"
    assert found["missed"] == ["k/2", "k/4"]
    assert found["false"] == ["k/3", "k/4"]
    assert found["late"] == ["k/1", "k/4"]


# --- cases and rows ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_case_depends_on_its_kind_and_seed_only(kind):
    first, again = case(kind, 3), case(kind, 3)
    assert first.world.digest() == again.world.digest()
    assert first.config.digest() == again.config.digest()
    assert case(kind, 4).world.digest() != first.world.digest()


def test_rounds_take_the_kinds_in_turn_and_repeat_no_case():
    names = list(cases(2, ("cork", "slow"), first=100))
    assert names == ["cork/100", "cork/101", "slow/100", "cork/102", "cork/103", "slow/101"]


def test_sampled_kinds_are_drawn_more_often_than_scripted_ones():
    assert all(WEIGHTS[kind] >= 2 for kind in SAMPLED)


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
