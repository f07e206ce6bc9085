from __future__ import annotations

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.feedback import Feedback
from mrta_falsify.core.protocols import Sampler


def _sampler(seed: int) -> Sampler:
    return registry.build("sampler", Choice("random", {"cube": {"dimensions": 3}, "seed": seed}))


def test_proposals_are_numbered_from_zero_without_gaps():
    sampler = _sampler(1)
    proposals = [sampler.ask() for _ in range(5)]
    assert [proposal.number for proposal in proposals] == [0, 1, 2, 3, 4]
    assert all(proposal.u.shape == (3,) for proposal in proposals)


def test_scores_do_not_change_what_comes_next():
    told, untold = _sampler(1), _sampler(1)
    first = told.ask()
    untold.ask()
    told.tell(Feedback(number=first.number, u=first.u, score=-3.0))
    np.testing.assert_array_equal(told.ask().u, untold.ask().u)


def test_seeds_differ_and_points_fill_the_cube():
    assert (_sampler(1).ask().u != _sampler(2).ask().u).any()
    sampler = _sampler(0)
    points = np.array([sampler.ask().u for _ in range(500)])
    assert points.min() >= 0.0
    assert points.max() < 1.0
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.05)
