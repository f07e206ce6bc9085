"""A failure belongs to a changed stack only if copies of the world say so."""

from __future__ import annotations

import dataclasses

import pytest

from benchmarks.copies import told_apart
from benchmarks.defects.worlds import PLANTS
from benchmarks.falsification import planted as campaigns
from benchmarks.mutation.runs import Run
from benchmarks.mutation.searching import told_of_copies
from mrta_falsify.core.config import StackConfig
from scenic_worlds.variation import jittered_worlds

WORLD = PLANTS["same_room_twice_stalls"].world(0)


class Stack:
    """Fails in the copies whose numbers it has; remembers which it was asked about."""

    def __init__(self, *fails: int) -> None:
        self._fails = fails
        self.asked: list[int] = []

    def __call__(self, world) -> bool:
        self.asked.append(world.seed)
        return world.seed in self._fails


@pytest.mark.parametrize(
    ("changed", "sound", "apart"),
    [
        ((0, 1, 2, 3), (), True),
        ((0, 2, 3), (1,), True),
        ((0, 1, 2, 3), (0, 3), False),
        ((0, 1), (), False),
        ((), (), False),
    ],
)
def test_three_of_four_copies_fail_and_at_most_one_of_the_sound_stack(changed, sound, apart):
    assert told_apart(WORLD, changed=Stack(*changed), sound=Stack(*sound)).apart is apart


def test_no_more_copies_are_run_than_it_takes():
    changed, sound = Stack(2, 3), Stack()
    assert str(told_apart(WORLD, changed=changed, sound=sound)).startswith("0 of 2 copies")
    assert (changed.asked, sound.asked) == ([0, 1], [])
    changed = Stack(0, 1, 2, 3)
    told = told_apart(WORLD, changed=changed, sound=sound)
    assert str(told) == "3 of 3 copies, the sound stack 0 of 3"
    assert (changed.asked, sound.asked) == ([0, 1, 2], [0, 1, 2])


def test_both_stacks_are_asked_about_the_copies_that_campaigns_run():
    seen = []
    told_apart(
        WORLD, changed=lambda world: bool(seen.append(world.digest())) or True, sound=Stack()
    )
    assert seen == [copy.digest() for copy in jittered_worlds(WORLD, 4)][:3]


def test_a_world_without_copies_tells_nothing(monkeypatch):
    monkeypatch.setattr("benchmarks.copies.TRIED", 3)
    assert not told_apart(WORLD, changed=Stack(0, 1, 2), sound=Stack()).apart


# --- planted defects -------------------------------------------------------------------------


@pytest.fixture
def told_of(monkeypatch):
    """What `planted` says of a failing world, with stacks that fail in the given copies."""

    def told(*, planted: Stack, sound: Stack):
        def judge(job, *, keep_trace):
            failed = (planted if job.config.defects else sound)(job.world)
            return type("Run", (), {"failed": failed})

        monkeypatch.setattr(campaigns, "judge", judge)
        monkeypatch.setattr(campaigns, "stored_world", lambda campaign, record: WORLD)
        config = StackConfig(defects=("same_room_twice_stalls",))
        return campaigns._told(None, None, config, ("deadlines",))

    return told


def test_a_failure_on_a_knife_edge_is_not_counted_for_a_planted_defect(told_of):
    """Before, one world that fails with the defect and passes without it was enough."""
    assert not told_of(planted=Stack(0, 1), sound=Stack()).apart
    assert not told_of(planted=Stack(0, 1, 2, 3), sound=Stack(1, 2)).apart
    assert told_of(planted=Stack(0, 1, 3), sound=Stack(2)).apart


def test_a_search_for_mutants_is_told_of_copies_as_a_campaign_is():
    run = Run(fate="judged", violated=("progress",), signature="x", objectives={"progress": -0.4})
    passes = dataclasses.replace(run, violated=(), signature="", objectives={"progress": 0.6})
    crashes = Run(fate="crash", error="ZeroDivisionError")
    edge = told_of_copies(run, [passes, passes, run, passes])
    assert edge["signature"] != run.signature
    robust = told_of_copies(run, [run, crashes, run, passes])
    assert robust["signature"] == run.signature
    assert robust["score"] < 0.0 < edge["score"]
    assert robust["objectives"]["progress"] < edge["objectives"]["progress"] < 0.6
    assert edge["noise"]["progress"] > 0.0
