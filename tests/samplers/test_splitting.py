from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import stream
from samplers.splitting import ChainState, SplittingSampler, resample

SMALL = {"repeats": 6, "chains": 8, "steps": 3, "pilot": 12}


def build(dimensions=4, seed=0, **sizes):
    cube = Cube(dimensions=dimensions)
    return SplittingSampler(SplittingSampler.Options(cube=cube, seed=seed, **{**SMALL, **sizes}))


def drive(sampler, margin, *, window=1, most=20_000):
    """Ask and tell until there are estimates; the number of trials."""
    waiting = []
    for trials in range(most):
        if sampler.estimates().repeats:
            return trials
        waiting.append(sampler.ask())
        if len(waiting) == window:
            proposal = waiting.pop(0)
            value = margin(proposal)
            sampler.tell(
                Feedback(number=proposal.number, u=proposal.u, score=value, failed=value < 0.0)
            )
    raise AssertionError("no estimates")


def in_a_corner(p, dimensions=4):
    """Violated with probability ``p``: all coordinates below a bound."""
    bound = p ** (1.0 / dimensions)
    return lambda proposal: float(proposal.u.max()) - bound


@pytest.mark.parametrize("window", [1, 8])
def test_the_mean_of_many_runs_is_the_probability(window):
    p = 1e-3
    repeats = np.concatenate(
        [
            (drive(sampler, in_a_corner(p), window=window), sampler.estimates().repeats)[1]
            for sampler in (build(seed=seed, repeats=12) for seed in range(3))
        ]
    )
    error = repeats.std() / np.sqrt(len(repeats))
    assert abs(repeats.mean() - p) < 4.0 * error
    assert error < p


def test_a_rare_violation_takes_far_fewer_trials_than_it_is_rare():
    sampler = build(repeats=4, chains=12, steps=5)
    trials = drive(sampler, in_a_corner(1e-5))
    assert trials < 5000
    assert 1e-6 < np.mean(sampler.estimates().repeats) < 1e-4


def test_a_score_that_is_flat_where_it_is_safe_does_not_bias_it():
    def staircase(proposal):
        value = in_a_corner(0.01)(proposal)
        return value if value < 0.0 else float(np.ceil(4.0 * value) / 4.0)

    found = []
    for seed in range(3):
        sampler = build(seed=seed)
        drive(sampler, staircase)
        found += sampler.estimates().repeats
    assert abs(np.mean(found) - 0.01) < 4.0 * np.std(found) / np.sqrt(len(found))


def test_a_common_violation_needs_no_level():
    sampler = build()
    drive(sampler, lambda proposal: float(proposal.u[0]) - 0.5)
    found = sampler.estimates().repeats
    assert np.mean(found) == pytest.approx(0.5, abs=0.15)


def test_where_nothing_is_ever_violated_every_run_is_zero_and_the_uniform_trials_count():
    sampler = build(most_levels=3)
    drive(sampler, lambda proposal: 1.0)
    found = sampler.estimates()
    assert set(found.repeats) == {0.0}
    assert found.uniform_failures == 0
    assert found.uniform_trials == 12 * 3 + 6 * 8 * 3


def test_every_run_of_a_batch_costs_the_same_also_one_that_finds_nothing():
    # Two levels that single runs often miss, so that some of them end early with 0.
    margin = in_a_corner(1e-5)
    sampler = build(chains=2, steps=2, repeats=30)
    trials = drive(sampler, margin)
    assert min(sampler.estimates().repeats) == 0.0
    again = build(chains=2, steps=2, repeats=30)
    pilot = next(
        n for n in itertools.count(1) if _tell_one(again, margin) and again._levels is not None
    )
    assert trials - pilot == 30 * 2 * 2 * (len(again._levels) + 1)


def _tell_one(sampler, margin):
    proposal = sampler.ask()
    value = margin(proposal)
    sampler.tell(Feedback(number=proposal.number, u=proposal.u, score=value, failed=value < 0.0))
    return True


def test_rejected_draws_are_made_again_and_replaced_scenes_do_not_move_a_chain():
    # Half of the cube has no scene: a draw there is replaced by a uniform one, as mode exact does.
    def conditional(sampler):
        for _ in range(30_000):
            if sampler.estimates().repeats:
                return sampler.estimates().repeats
            proposal = sampler.ask()
            u, own = np.array(proposal.u), stream(proposal.number, "test/scene")
            while u[0] > 0.5:
                u = own.random(4)
            value = float(np.array([2.0 * u[0], *u[1:]]).max()) - 1e-3**0.25
            fate = "rejected" if proposal.number % 7 == 0 else "judged"
            sampler.tell(
                Feedback(number=proposal.number, u=u, score=value, failed=value < 0.0, fate=fate)
            )
        raise AssertionError("no estimates")

    found = np.concatenate([conditional(build(seed=seed, repeats=12)) for seed in range(3)])
    assert abs(found.mean() - 1e-3) < 4.0 * found.std() / np.sqrt(len(found))


def test_it_says_how_many_trials_are_missing():
    sampler = build()
    assert "looking for levels" in sampler.estimates().waiting_for
    while sampler._levels is None:
        _tell_one(sampler, in_a_corner(1e-3))
    assert "more trials" in sampler.estimates().waiting_for


def test_resampling_takes_each_state_equally_often_up_to_one():
    states = [ChainState(np.zeros(1), (float(i), 0.0)) for i in range(3)]
    taken = resample(states, 8, stream(0, "test"))
    counts = sorted(taken.count(state) for state in states)
    assert counts == [2, 3, 3]
    assert len(set(map(id, resample(states, 2, stream(0, "test"))))) == 2


def test_moves_keep_the_uniform_distribution():
    sampler = build(dimensions=3)
    u, seen = np.full(3, 0.01), []
    for number in range(3000):
        u = sampler._moved(u, stream(number, "test/moves"))
        seen.append(u)
    for i in range(3):
        thinned = np.array(seen)[200::20, i]
        assert stats.kstest(thinned, "uniform").pvalue > 1e-3
