"""Search beside failures that most copies do not share."""

import numpy as np
import pytest

from mrta_falsify.core.feedback import Cube, Feedback
from samplers.auto import AutoSampler
from samplers.knife_edges import KnifeEdgesSampler

CUBE = Cube(
    dimensions=8,
    levels=(0, 0, 0, 4, 0, 0, 0, 0),
    groups=(0, 0, 1, 1, 2, 3, 4, 5),
    owners=tuple("abcdef"),
)
HERE, THERE = np.full(8, 0.3), np.full(8, 0.7)


def edges(**options) -> KnifeEdgesSampler:
    return KnifeEdgesSampler(KnifeEdgesSampler.Options(cube=CUBE, **options))


def failure(u, copies, *, signature="progress", blamed=(0, 1)) -> Feedback:
    what = {"signature": signature, "copies": copies, "blamed": blamed}
    return Feedback(number=0, u=u, score=-0.3, failed=True, **what)


def passing(u) -> Feedback:
    return Feedback(number=0, u=u, score=0.5)


def test_who_took_part_moves_a_little_and_the_others_in_every_other_child():
    sampler = edges()
    sampler.tell(failure(HERE, (1, 3)))
    children = np.array([sampler.ask().u for _ in range(200)])
    part, others = children[:, :4], children[:, 4:]
    assert (part[:, :3] != HERE[0]).all()
    assert np.abs(part - HERE[0]).max() < 0.4
    assert (part[:, 3] == HERE[0]).all()  # a neighbour among levels means nothing
    assert (others == HERE[0]).all(axis=1).mean() == pytest.approx(0.5 + 0.5**5, abs=0.12)
    assert (others != HERE[0]).mean() == pytest.approx(0.25, abs=0.06)


def test_without_blame_everything_moves():
    sampler = edges()
    sampler.tell(failure(HERE, (0, 2), blamed=()))
    child = sampler.ask().u
    assert (np.delete(child, 3) != HERE[0]).all()
    assert np.abs(child - HERE).max() < 0.4


def test_the_likelier_failure_has_more_children_until_they_pass():
    sampler = edges()
    sampler.tell(failure(HERE, (0, 2), signature="a"))
    sampler.tell(failure(THERE, (4, 8), signature="b"))

    def beside_there() -> float:
        return float(
            np.mean([np.abs(sampler.ask().u[:3] - THERE[:3]).max() < 0.3 for _ in range(200)])
        )

    assert beside_there() > 0.6
    for _ in range(60):
        sampler.tell(passing(THERE))
    assert beside_there() < 0.5


def test_results_far_off_say_nothing_about_it():
    sampler = edges()
    sampler.tell(failure(HERE, (1, 3)))
    sampler.tell(passing(np.array([0.3, 0.5, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3])))  # in a part of a
    (edge,) = sampler._edges
    assert (edge.failed, edge.passed) == (1, 2)
    sampler.tell(passing(np.array([0.3, 0.4, 0.3, 0.3, 0.9, 0.9, 0.9, 0.9])))  # in no part
    assert (edge.failed, edge.passed) == (1, 3)


def test_it_is_left_once_a_robust_failure_of_its_kind_is_known():
    sampler = edges()
    sampler.tell(failure(HERE, (1, 3)))
    assert sampler.has_any
    sampler.tell(failure(THERE, (4, 4), signature="no_deadlock"))
    assert sampler.has_any
    sampler.tell(failure(THERE, (4, 4)))
    assert not sampler.has_any
    sampler.tell(failure(HERE, (1, 3)))
    assert not sampler.has_any
    assert sampler.ask().uniform


@pytest.mark.parametrize(
    ("copies", "expected"),
    [((0, 0), False), ((0, 2), True), ((2, 4), True), ((3, 4), False), ((3, 3), False)],
)
def test_failures_without_copies_are_no_knife_edges(copies, expected):
    told = failure(HERE, copies)
    assert told.is_knife_edge is expected
    assert told.kind == (f"{copies[0]} of {copies[1]} copies: progress" if expected else "progress")


@pytest.mark.parametrize(("chase", "least", "most"), [(0.0, 0, 4), (1.0, 24, 24)])
def test_auto_looks_beside_knife_edges_between_its_uniform_proposals(chase, least, most):
    sampler = AutoSampler(AutoSampler.Options(cube=CUBE, chase=chase, coverage=False, robust=True))
    near = 0
    for number in range(38):
        proposal = sampler.ask()
        if number == 0:
            sampler.tell(failure(HERE, (2, 4)))
            continue
        is_near = (
            bool((np.abs(proposal.u[:4] - HERE[:4]) < 0.35).all()) and proposal.u[3] == HERE[3]
        )
        near += is_near and not proposal.uniform
        far = np.full(8, 0.9)  # what is told lies elsewhere, so that nothing else attracts
        sampler.tell(Feedback(number=number, u=far, score=0.5 - 0.01 * number))
    assert least <= near <= most
