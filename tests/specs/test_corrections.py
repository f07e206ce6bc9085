"""Taking the blockers away corrects the edges of the wait-for graph."""

from frames import Robot, Script

from mrta_falsify.core import codec
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.specs.deadlock.corrections import Removals, corrected
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.watches import CounterfactualAnswer

BEHIND, BESIDE = BlockedBy(0, "barrier", 1), BlockedBy(0, "barrier", 2)
WALL = BlockedBy(0, "wall", -1, "bed")


def removals(*, is_outside: bool = False, **answers: CounterfactualAnswer | None) -> Removals:
    """Removals that show what ``answers`` say by the robots that are gone, as ``without_1_2``."""
    world = Script(robots=[Robot((0, 0)), Robot((1, 0)), Robot((2, 0))]).world()

    def forecast(watch, *, without=(), nudge=0, to_come=False):
        answer = answers["without_" + "_".join(map(str, without))]
        return None if answer is None else codec.encode(answer)

    forecast.is_outside = is_outside
    return Removals(forecast, ProgressClock(world), 10.0, 120.0, 5)


def shown(*edges: BlockedBy, nearer: tuple[int, ...] = ()) -> CounterfactualAnswer:
    return CounterfactualAnswer(freed=(), nearer=nearer, edges=edges)


def test_an_edge_holds_if_the_robot_gets_nearer_without_its_blocker():
    found = corrected({0: [BEHIND]}, {0, 1}, removals(without_1=shown(nearer=(0,))))
    assert found[0] == [BEHIND]


def test_what_holds_the_robot_without_its_blocker_takes_the_edge_s_place():
    assert corrected({0: [BEHIND]}, {0, 1}, removals(without_1=shown(WALL)))[0] == [WALL]
    stalled = BlockedBy(0, "stalled")
    assert corrected({0: [BEHIND]}, {0, 1}, removals(without_1=shown(stalled)))[0] == [stalled]


def test_a_removal_that_cannot_be_tried_changes_nothing():
    assert corrected({0: [BEHIND]}, {0, 1}, removals(without_1=None))[0] == [BEHIND]


def test_two_blockers_that_hold_a_robot_together_stay():
    tried = removals(
        without_1=shown(BESIDE), without_2=shown(BEHIND), without_1_2=shown(nearer=(0,))
    )
    assert corrected({0: [BEHIND, BESIDE]}, {0, 1, 2}, tried)[0] == [BEHIND, BESIDE]


def test_two_blockers_without_whom_the_robot_stands_all_the_same_go():
    tried = removals(without_1=shown(BESIDE), without_2=shown(BEHIND), without_1_2=shown(WALL))
    assert corrected({0: [BEHIND, BESIDE]}, {0, 1, 2}, tried)[0] == [WALL]


def test_a_stack_outside_that_may_remember_locks_loses_an_edge_to_a_named_thing_only():
    stalled = removals(is_outside=True, without_1=shown(BlockedBy(0, "stalled")))
    assert corrected({0: [BEHIND]}, {0, 1}, stalled)[0] == [BEHIND]
    named = removals(is_outside=True, without_1=shown(WALL))
    assert corrected({0: [BEHIND]}, {0, 1}, named)[0] == [WALL]


def test_a_neighbour_that_is_near_and_no_more_is_no_lock():
    near = BlockedBy(0, "cluster", 1)
    stalled = removals(is_outside=True, without_1=shown(BlockedBy(0, "stalled")))
    assert corrected({0: [near]}, {0, 1}, stalled)[0] == [BlockedBy(0, "stalled")]


def test_robots_that_stand_behind_each_other_hold_a_robot_together():
    """The one behind takes the place of the one that is gone, and was in no edge before."""
    tried = removals(
        without_1=shown(BESIDE), without_1_2=shown(nearer=(0,)), without_2=shown(BEHIND)
    )
    assert corrected({0: [BEHIND]}, {0, 1, 2}, tried)[0] == [BEHIND, BESIDE]


def test_a_robot_without_whom_all_stays_as_it_was_is_left_out_of_those_that_hold_together():
    far = BlockedBy(0, "barrier", 3)
    tried = removals(
        without_1=shown(BESIDE, far),
        without_1_2_3=shown(nearer=(0,)),
        without_1_2=shown(nearer=(0,)),
        without_1_3=shown(BESIDE),
        without_2_3=shown(BEHIND),
        without_2=shown(BEHIND),
        without_3=shown(BEHIND),
    )
    assert corrected({0: [BEHIND]}, {0, 1, 2, 3}, tried)[0] == [BEHIND, BESIDE]
