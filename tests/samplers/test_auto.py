"""``auto``: which proposals are uniform, whose the others are, what its parts are told."""

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.feedback import DEMANDS, Cube, Feedback, SceneLoads
from samplers.asking import BLAMED, Mutator
from samplers.auto import AutoSampler

CUBE = Cube(dimensions=6, groups=(0, 0, 1, 1, 2, 2), owners=("a", "b", "c"))


def auto(**options) -> AutoSampler:
    return AutoSampler(AutoSampler.Options(cube=CUBE, **options))


def told(proposal, **what) -> Feedback:
    return Feedback(number=proposal.number, u=proposal.u, score=0.5, **what)


def test_the_first_proposal_and_one_in_five_are_uniform_whatever_was_told():
    def proposals(score: float):
        sampler = auto()
        for _ in range(40):
            proposal = sampler.ask()
            sampler.tell(dataclasses.replace(told(proposal), score=score * proposal.u[0]))
            yield proposal

    some, others = list(proposals(1.0)), list(proposals(-1.0))
    uniform = {p.number for p in some if p.uniform}
    assert uniform == {*range(0, 40, 5)} == {p.number for p in others if p.uniform}
    for one, other in zip(some, others, strict=True):
        if one.uniform:
            np.testing.assert_array_equal(one.u, other.u)


def test_children_change_objects_that_took_part_more_often():
    mutator = Mutator(Cube(dimensions=10), mean_blocks=1.0)
    random, parent = np.random.default_rng(0), np.full(10, 0.5)
    changed = np.zeros(10)
    for _ in range(2000):
        changed += mutator.child(parent, 0.1, random, blamed=(3,)) != parent
    others = np.delete(changed, 3).mean()
    assert changed[3] / others == pytest.approx(BLAMED, rel=0.2)


def test_four_in_five_of_what_is_not_uniform_are_demanding_scenes():
    sampler = auto()
    sampler.rehearse_by(lambda u: SceneLoads(u, np.zeros(len(DEMANDS))))
    asked = Proposal(number=0, u=np.full(6, 0.5))
    whose = []
    for name in ("_demanding", "_model"):
        part = getattr(sampler, name)
        part.ask = lambda name=name: whose.append(name) or asked
    for _ in range(500):
        sampler.ask()
    assert len(whose) == 400
    assert 290 <= whose.count("_demanding") <= 350


def test_the_model_weighs_demanding_scenes_once_it_knows_results():
    random = np.random.default_rng(0)
    sampler = auto()
    sampler.rehearse_by(lambda u: SceneLoads(u, np.resize(u, len(DEMANDS))))
    points = np.array([[0.9] * 6, [0.1] * 6, [0.5] * 6])
    assert np.ptp(sampler._demanding._weigh(points)) == 0.0
    for number, u in enumerate(random.random((40, 6))):
        margin = {"progress": float(u[0] + random.normal(0.0, 0.3))}
        sampler.tell(Feedback(number=number, u=u, score=u[0], objectives=margin))
    weighed = sampler._demanding._weigh(points)
    assert weighed[1] > weighed[2] > weighed[0]


def test_without_rehearsals_all_but_uniform_proposals_are_of_the_model():
    sampler = auto()
    proposed = [sampler._next() for _ in range(40)]
    assert set(proposed) == {sampler._model}
