from __future__ import annotations

import random

import numpy as np
import pytest

from mrta_falsify.core.feedback import Cube, Feedback

pytest.importorskip("verifai")

CUBE = Cube(dimensions=4, levels=(0, 3, 0, 5))


def build(cube=CUBE, seed=0):
    from samplers.verifai_sampling import VerifaiCrossEntropy

    return VerifaiCrossEntropy(VerifaiCrossEntropy.Options(cube=cube, seed=seed))


def test_global_generators_are_as_they_were():
    sampler = build()
    random.seed(4)
    np.random.seed(4)  # noqa: NPY002 - what VerifAI draws from
    expected = random.random(), np.random.random()  # noqa: NPY002
    random.seed(4)
    np.random.seed(4)  # noqa: NPY002
    for _ in range(3):
        proposal = sampler.ask()
        sampler.tell(Feedback(number=proposal.number, u=proposal.u, score=-1.0, failed=True))
    assert (random.random(), np.random.random()) == expected  # noqa: NPY002


def test_a_discrete_coordinate_is_in_the_middle_of_its_values():
    sampler = build()
    points = np.array([sampler.ask().u for _ in range(40)])
    np.testing.assert_allclose(points[:, 1] * 3 - 0.5, np.round(points[:, 1] * 3 - 0.5))
    assert set(np.round(points[:, 3] * 5 - 0.5)) == {0.0, 1.0, 2.0, 3.0, 4.0}


def test_cross_entropy_leans_to_violations():
    sampler = build(Cube(dimensions=1))
    for _ in range(200):
        proposal = sampler.ask()
        score = float(proposal.u[0]) - 0.2
        sampler.tell(
            Feedback(number=proposal.number, u=proposal.u, score=score, failed=score < 0.0)
        )
    late = [float(sampler.ask().u[0]) for _ in range(50)]
    assert np.mean(np.array(late) < 0.2) > 0.8
