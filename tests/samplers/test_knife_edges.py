"""Knife edges: which of them have children, how many, and whether that leads to robust failures."""

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.feedback import Cube, Feedback
from samplers.auto import BESIDE, AutoSampler
from samplers.knife_edges import CHILDREN, KnifeEdgesSampler

CUBE = Cube(dimensions=6, groups=(0, 0, 1, 1, 2, 2), owners=("a", "b", "c"))
MIDDLE = np.full(6, 0.5)


def failure(number, *, chance, u=MIDDLE, mode="no_deadlock/2") -> Feedback:
    """Fail in a share of all copies; robustly, if that is more than half."""
    return Feedback(number=number, u=u, score=0.5 - chance, failed=True, mode=mode)


def children_of(sampler) -> list[np.ndarray]:
    """Ask for as many children as there are."""
    found = []
    while sampler.has_any:
        found.append(sampler.ask().u)
    return found


@pytest.fixture
def sampler():
    return KnifeEdgesSampler(KnifeEdgesSampler.Options(cube=CUBE))


@pytest.mark.parametrize(("chance", "count"), [(0.2, 0), (0.4, 0), (0.5, CHILDREN), (0.8, 0)])
def test_those_have_children_that_half_of_their_copies_share(sampler, chance, count):
    sampler.tell(Feedback(number=0, u=MIDDLE, score=0.0))  # no failure
    sampler.tell(failure(1, chance=chance))
    children = children_of(sampler)
    assert len(children) == count
    for child in children:
        assert 1 <= (child != MIDDLE).sum() <= 6
    if not children:
        assert sampler.ask().uniform


def test_who_has_fewest_children_has_the_next_one_and_of_these_the_latest(sampler):
    first, second = np.full(6, 0.1), np.full(6, 0.9)
    sampler.tell(failure(0, chance=0.5, u=first))
    sampler.ask()
    sampler.tell(failure(1, chance=0.5, u=second))
    of_second = [(child > 0.5).sum() > 3 for child in children_of(sampler)]
    assert of_second == [True, True] + [False, True] * (CHILDREN - 2) + [False]


def test_what_has_a_robust_failure_of_its_mode_is_left(sampler):
    sampler.tell(failure(0, chance=0.5, mode="no_deadlock/2"))
    sampler.tell(failure(1, chance=0.5, mode="no_deadlock/3"))
    sampler.tell(failure(2, chance=0.9, mode="no_deadlock/2"))
    assert len(children_of(sampler)) == CHILDREN
    sampler.tell(failure(3, chance=0.5, mode="no_deadlock/2"))
    assert not sampler.has_any


def test_skipped_proposals_change_nothing_in_later_ones():
    def later(is_skipped):
        sampler = KnifeEdgesSampler(KnifeEdgesSampler.Options(cube=CUBE))
        for number in range(2):
            sampler.tell(failure(number, chance=0.5, u=np.full(6, 0.3 + 0.3 * number)))
        for _ in range(3):
            sampler.skip() if is_skipped else sampler.ask()
        return children_of(sampler)

    np.testing.assert_array_equal(later(True), later(False))


def proposed_by_auto(options: AutoSampler.Options, count: int, *, edges: int):
    """Say which proposals of ``auto`` are children, after so many knife edges."""
    sampler = AutoSampler(options)
    for number in range(edges):
        sampler.tell(failure(number, chance=0.5))
    mine, of = [], sampler._knife_edges.ask
    sampler._knife_edges.ask = lambda: mine.append(sampler._counter.next) or of()
    asked = [sampler.ask() for _ in range(count)]
    return mine, [proposal for proposal in asked if not proposal.uniform]


def test_auto_gives_knife_edges_half_of_what_is_not_uniform():
    options = AutoSampler.Options(cube=CUBE)
    mine, others = proposed_by_auto(options, 100, edges=20)
    assert len(mine) / len(others) == pytest.approx(BESIDE, abs=0.15)
    mine, _ = proposed_by_auto(options, 100, edges=1)
    assert len(mine) == CHILDREN
    for none in ({"edges": 0}, {"edges": 20}):
        without = dataclasses.replace(options, edges=none["edges"] == 0)
        assert proposed_by_auto(without, 30, **none)[0] == []


def test_children_climb_to_robust_failures():
    """A scene fails with a chance that four of its six coordinates decide; few fail robustly."""

    def trial(number, u, random) -> Feedback:
        chance = float(np.exp(-(((u[:4] - 0.8) / 0.22) ** 2).sum()))
        if random.random() >= chance:
            return Feedback(number=number, u=u, score=0.5)
        copies = int((random.random(4) < chance).sum())
        return failure(number, chance=(copies + 1) / 6, u=u)

    tried, robust = {True: 0, False: 0}, {True: 0, False: 0}  # children or not
    for seed in range(30):
        random = np.random.default_rng(seed)
        sampler = KnifeEdgesSampler(KnifeEdgesSampler.Options(cube=CUBE, seed=seed))
        is_found = False
        for number in range(100):
            is_child = number % 2 == 1 and sampler.has_any
            result = trial(number, sampler.ask().u if is_child else random.random(6), random)
            tried[is_child] += not is_found
            robust[is_child] += not is_found and result.score < 0.0
            is_found |= result.score < 0.0
            sampler.tell(result)
    assert robust[True] / tried[True] > 3.0 * robust[False] / tried[False], (robust, tried)
