"""``auto``: which proposals are uniform, whose the others are, what its parts are told."""

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.feedback import DEMANDS, NEAR_DEADLOCK, Cube, Feedback, Rehearsed
from samplers.asking import BLAMED, Mutator
from samplers.auto import AutoSampler
from samplers.situations import SituationsSampler

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


@pytest.mark.parametrize("slope", [True, False])
def test_how_near_a_run_came_to_a_deadlock_is_a_margin_and_part_of_the_score(slope):
    sampler = auto(slope=slope)
    heard = []
    sampler._model.tell = heard.append
    proposal = sampler.ask()
    for cycle in (0.0, 0.8):
        sampler.tell(told(proposal, descriptors={"cycle": cycle}, objectives={"a": 0.5}))
    far, near = heard
    if slope:
        assert near.objectives == {"a": 0.5, NEAR_DEADLOCK: pytest.approx(0.2)}
        assert near.score < far.score
    else:
        assert near.objectives == {"a": 0.5}
        assert near.score == far.score


def test_a_knife_edge_with_a_deadlock_is_near_and_a_robust_one_is_beyond():
    sampler = auto()
    proposal = sampler.ask()
    run = told(proposal, failed=True, descriptors={"cycle": 1.0})
    for mean, expected in ((0.4, 0.05), (-0.7, -0.7)):
        seen = sampler._seen(dataclasses.replace(run, objectives={"no_deadlock": mean}))
        assert seen.objectives[NEAR_DEADLOCK] == expected
        assert seen.score == run.score


def test_children_change_objects_that_took_part_more_often():
    mutator = Mutator(Cube(dimensions=10), mean_blocks=1.0)
    random, parent = np.random.default_rng(0), np.full(10, 0.5)
    changed = np.zeros(10)
    for _ in range(2000):
        changed += mutator.child(parent, 0.1, random, blamed=(3,)) != parent
    others = np.delete(changed, 3).mean()
    assert changed[3] / others == pytest.approx(BLAMED, rel=0.2)


def test_blame_can_be_switched_off():
    run = Feedback(number=0, u=np.zeros(6), blamed=(1,))
    assert auto()._seen(run).blamed == (1,)
    assert auto(blame=False)._seen(run).blamed == ()


def test_half_of_what_is_not_uniform_are_demanding_scenes():
    sampler = auto()
    sampler.rehearse_by(lambda u: Rehearsed(u, np.zeros(len(DEMANDS))))
    asked = Proposal(number=0, u=np.full(6, 0.5))
    whose = []
    for name in ("_demanding", "_model"):
        part = getattr(sampler, name)
        part.ask = lambda name=name: whose.append(name) or asked
    for _ in range(500):
        sampler.ask()
    assert len(whose) == 400
    assert 160 <= whose.count("_demanding") <= 240


def test_without_rehearsals_all_but_uniform_proposals_are_of_the_model():
    sampler = auto()
    proposed = [sampler._next() for _ in range(40)]
    assert set(proposed) == {sampler._model}


def test_scenes_that_showed_what_few_did_have_more_children():
    sampler = SituationsSampler(SituationsSampler.Options(cube=CUBE, initial=20, step=0.01))
    rare = None
    for _ in range(20):
        proposal = sampler.ask()
        assert proposal.uniform
        situations = ("common", "rare") if proposal.number == 7 else ("common",)
        rare = proposal.u if proposal.number == 7 else rare
        sampler.tell(told(proposal, situations=situations))
    near = 0
    for _ in range(20):
        child = sampler.ask()
        near += (np.abs(child.u - rare) < 0.2).sum() >= 4
        sampler.tell(told(child, situations=("common",)))
    assert near >= 6  # evenly drawn it were one
