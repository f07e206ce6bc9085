"""How near a run came to a deadlock, who took part, and which situations it showed."""

import numpy as np
import pytest
from frames import DT, Robot, Script, corridor, drive, room_resource, stop_at

from mrta_falsify.core.fleet import BlockedBy, StackEvent
from mrta_falsify.core.world import Task
from mrta_falsify.specs.deadlock.occupancy import GRID_CELL
from mrta_falsify.specs.descriptors import NAMES, Descriptors
from mrta_falsify.specs.near_deadlock import narrow_places
from mrta_falsify.specs.waits import awaited, followers, in_cycles, waits_of


def described(script: Script) -> Descriptors:
    world = script.world()
    found = Descriptors(world, DT)
    for frame in script.frames(world):
        found.update(frame)
    assert set(found.values()) == set(NAMES)
    assert all(0.0 <= value <= 1.0 for value in found.values().values())
    return found


# --- the graph ---------------------------------------------------------------------------------


def test_people_and_things_are_no_robots_to_wait_for():
    edges = [
        BlockedBy(0, "human", 1),
        BlockedBy(1, "wall", resource="bed"),
        BlockedBy(2, "task"),
        BlockedBy(3, "barrier", 0),
    ]
    assert waits_of(edges) == {3: {0}}


def test_a_ring_is_a_cycle_and_who_waits_for_it_is_not_in_it():
    waits = {0: frozenset({1}), 1: frozenset({2}), 2: frozenset({0}), 3: frozenset({0})}
    assert in_cycles(waits) == {0, 1, 2}
    assert awaited(waits, 3) == {0, 1, 2}
    assert followers(waits) == {}


def test_all_that_wait_directly_or_through_others_follow_the_one_that_waits_for_none():
    waits = {1: frozenset({0}), 2: frozenset({1}), 4: frozenset({5})}
    assert followers(waits) == {0: {1, 2}, 5: {4}}


# --- almost a cycle ------------------------------------------------------------------------------


def crossing(*way: tuple[float, float]) -> Script:
    """Robot 2 waits until robot 1, which crosses slowly, is past; robot 1 goes on along ``way``."""
    crosses = drive((0.0, -0.6), (0.0, 0.9), 0.2)
    return Script(
        [
            Robot(crosses, goal=way[-1], path=lambda time: (crosses(time)[:2], *way)),
            Robot((-0.8, 0.0), goal=(5.0, 0.0), path=((-0.8, 0.0), (5.0, 0.0))),
        ],
        seconds=6.0,
    )


def test_a_robot_whose_way_leads_past_the_one_that_waits_for_it_is_nearly_a_cycle():
    away = described(crossing((0.0, 5.0)))
    towards = described(crossing((0.0, 1.0), (-0.8, 1.0), (-0.8, -3.0)))
    assert away.values()["cycle"] == 0.0 < towards.values()["cycle"] < 0.5
    assert towards.involved() == ("robot1", "robot2")


def test_the_later_the_missing_edge_the_less_near():
    def cycle(detour: float) -> float:
        script = crossing((0.0, detour), (-0.8, detour), (-0.8, -3.0))
        return described(script).values()["cycle"]

    assert cycle(2.4) < cycle(1.6) < cycle(1.0)


def head_on(seconds: float) -> Script:
    """Two robots that stand nose to nose in the open for some time."""
    return Script(
        [
            Robot((0.0, 0.0), goal=(5.0, 0.0)),
            Robot((0.6, 0.0), goal=(-5.0, 0.0)),
        ],
        seconds=seconds,
        tasks=[Task(arrival=0.0, start=0, end=1, deadline=90.0)] * 2,
        rooms=((5.0, 0.0), (-5.0, 0.0)),
        stack_events=lambda tick: (
            (StackEvent(time=0.0, kind="assigned", robot=1, task=1),) if tick == 0 else ()
        ),
    )


def test_a_closed_cycle_counts_more_the_longer_it_lasts_and_names_who_is_in_it():
    short, long = described(head_on(6.0)), described(head_on(25.0))
    assert 0.5 <= short.values()["cycle"] < long.values()["cycle"] < 1.0
    assert long.involved() == ("robot1", "robot2", "tasks[1]")


def test_robots_that_never_meet_are_not_near():
    script = Script(
        [Robot(drive((-5, 3), (5, 3), 0.5), goal=(5, 3)), Robot(drive((-5, -3), (5, -3), 0.5))],
        seconds=10.0,
    )
    found = described(script)
    assert found.values()["cycle"] == found.values()["encroachment"] == 0.0
    assert found.involved() == ()


# --- narrow places -------------------------------------------------------------------------------


def meeting(gap: float, width: float = 1.0, back: bool = True) -> Script:
    """Robot 1 leaves a corridor to the east; ``gap`` seconds later robot 2 enters from there."""
    out = drive((-5.0, 0.0), (8.0, 0.0), 1.0)
    aside = drive((8.0, 0.0), (8.0, 4.0), 1.0, leave=13.0)

    def first(time: float):
        return out(time) if time < 13.0 else aside(time)

    start, end = ((8.0, 0.0), (-5.0, 0.0)) if back else ((-5.0, 0.0), (8.0, 0.0))
    second = drive(start, end, 1.0, leave=13.0 + gap)
    waiting = (8.0, -3.0) if back else (-8.0, -3.0)
    return Script(
        [
            Robot(first, goal=(8.0, 4.0)),
            Robot(lambda t: second(t) if t > 13.0 + gap else (*waiting, 0.0), goal=end),
        ],
        seconds=30.0,
        walls=corridor(width),
    )


def test_the_sooner_a_narrow_place_is_used_the_other_way_the_nearer():
    near, far = described(meeting(1.0)), described(meeting(8.0))
    assert near.values()["encroachment"] > far.values()["encroachment"] > 0.0
    assert near.involved() == ("robot1", "robot2")


@pytest.mark.parametrize(("width", "back"), [(4.0, True), (1.0, False)])
def test_where_two_can_pass_or_follow_each_other_is_no_encroachment(width, back):
    assert described(meeting(1.0, width, back)).values()["encroachment"] == 0.0


def test_a_corridor_is_narrow_up_to_the_width_of_two_robots():
    for width, expected in ((0.8, True), (3.0, False)):
        world = meeting(1.0, width).world()
        row, col = ((np.zeros(2) - world.bounds[:2]) / GRID_CELL).astype(int)[::-1]
        assert bool(narrow_places(world)[row, col]) is expected


# --- situations ----------------------------------------------------------------------------------


def test_situations_tell_cause_place_part_and_phase_but_no_robot():
    found = described(head_on(6.0)).situations()
    assert found == ("barrier open floor cycle off",)


def test_everyday_events_are_no_situations_and_others_name_their_place():
    def events(tick: int):
        if tick != 3:
            return ()
        return (
            StackEvent(time=0.15, kind="granted", robot=0, resource="ward"),
            StackEvent(time=0.15, kind="waypoint", robot=0),
            StackEvent(time=0.15, kind="no-path", robot=0, detail="goal-blocked"),
        )

    script = Script([Robot((0.0, 0.0))], seconds=1.0, stack_events=events)
    assert described(script).situations() == ("event granted ward", "event no-path")


def test_waiting_in_a_queue_names_the_resource():
    script = Script(
        [
            Robot(stop_at(drive((0.0, 3.0), (0.0, 0.0), 1.0), 3.0), goal=(0.0, 0.0)),
            Robot((2.0, 0.0), goal=(2.0, 0.0)),
        ],
        seconds=6.0,
        rooms=((0.0, 0.0),),
        resources=(room_resource(0, (0.0, 0.0), [(2.0, 0.0), (3.0, 0.0)]),),
    )
    assert any(name.startswith("queue room0 waits") for name in described(script).situations())
