"""Labels by continuation, on scenes whose fate is plain."""

import dataclasses

import pytest
from shapely.geometry import box

from benchmarks.oracle.floors import robot, two_rooms
from benchmarks.oracle.labels import label, stopped
from benchmarks.oracle.stacks import stack
from benchmarks.oracle.worlds import KINDS, SAMPLED, WEIGHTS, case, cases
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, Task


def cut_off(end: float):
    """One robot, and from the start to ``end`` a cart across its only way."""
    world = two_rooms(box(-1.5, -0.5, 1.5, 0.5), side=2.0, gap=3.0)
    cart = Blockage(name="cart", polygon=rectangle(0.5, 1.0, (0.0, 0.0)), start=0.0, end=end)
    return dataclasses.replace(
        world,
        robots=(robot(0, -2.5, 0.0),),
        tasks=(Task(arrival=0.0, start=0, end=1, deadline=900.0),),
        events=(cart,),
    )


def test_a_robot_that_is_cut_off_for_good_is_a_deadlock_by_itself():
    (found,) = label(cut_off(1e6), stack(), 8.0).deadlocks
    assert found.members == found.group == (0,)
    assert found.stands
    assert found.onset < 8.0


def test_a_robot_whose_way_opens_again_is_none():
    assert label(cut_off(40.0), stack(), 8.0).deadlocks == ()


@pytest.mark.slow
def test_the_early_end_of_a_continuation_does_not_change_its_label():
    short = label(cut_off(1e6), stack(), 8.0)
    whole = label(cut_off(1e6), stack(), 8.0, thorough=True)
    assert short.deadlocks == whole.deadlocks
    assert short.continued < 100.0 < 599.0 < whole.continued


def test_nothing_comes_from_outside_after_the_moment():
    late = Task(arrival=20.0, start=1, end=0, deadline=900.0)
    world = cut_off(1e6)
    world = dataclasses.replace(world, tasks=(*world.tasks, late))
    assert len(stopped(world, 10.0).tasks) == 1
    assert len(stopped(world, 30.0).tasks) == 2


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_case_depends_on_its_kind_and_seed_only(kind):
    first, again = case(kind, 3), case(kind, 3)
    assert first.world.digest() == again.world.digest()
    assert first.config.digest() == again.config.digest()
    assert case(kind, 4).world.digest() != first.world.digest()


def test_five_rounds_have_200_cases_and_half_of_them_are_sampled():
    weights = {kind: WEIGHTS.get(kind, 1) for kind in KINDS}
    assert 5 * sum(weights.values()) >= 200
    assert 2 * sum(weights[kind] for kind in SAMPLED) >= sum(weights.values())


def test_rounds_take_the_kinds_in_turn_and_repeat_no_case():
    names = [made.name for made in cases(2, ("cork", "slow"), first=100)]
    assert names == ["cork/100", "cork/101", "slow/100", "cork/102", "cork/103", "slow/101"]
