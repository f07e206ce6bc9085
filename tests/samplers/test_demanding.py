"""Samplers that look at scenes before they propose one."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.feedback import DEMANDS, Cube, Feedback, SceneLoads
from mrta_falsify.core.protocols import PreflightSampler
from samplers.asking import Mutator
from samplers.auto import AutoSampler
from samplers.demanding import DemandingSampler
from samplers.preflights import Preflights, standardised
from samplers.random import RandomSampler
from samplers.surrogate import SurrogateSampler

K = 12
CUBE = Cube(dimensions=K)
ARMS = {"demanding": DemandingSampler, "surrogate": SurrogateSampler, "auto": AutoSampler}


def preflight(u):
    """Demands that no coordinate tells alone; none of a scene whose first one is above 0.9."""
    if u[0] > 0.9:
        return None
    demands = np.zeros(len(DEMANDS))
    demands[0] = (np.abs(u - 0.5) < 0.15).sum()  # 12 with 1 uniform point in 2 million
    demands[1] = 100.0 * abs(u[1] - u[2])
    demands[3] = -u[4] * u[5]
    return SceneLoads(u, demands)


VARYING = (0, 1, 3)


def built(name, seed=3, cube=CUBE, by=preflight):
    made = ARMS[name]
    sampler = made(made.Options(cube=cube, seed=seed))
    if by is not None:
        sampler.rehearse_by(by)
    return sampler


def told(proposal, score=0.5, **more):
    return Feedback(number=proposal.number, u=proposal.u, score=score, **more)


def uniform_demands(count=2000):
    drawn = np.random.default_rng(0).random((count, K))
    return np.array([found.demands for found in map(preflight, drawn) if found is not None])


@pytest.mark.parametrize("name", ARMS)
def test_who_rehearses_says_so(name):
    assert isinstance(built(name), PreflightSampler)
    assert not isinstance(RandomSampler(RandomSampler.Options()), PreflightSampler)


def test_all_demands_that_vary_are_driven_up_about_equally_often():
    sampler = built("demanding")
    usual = uniform_demands()[:, VARYING]
    heavy = np.zeros(len(VARYING))
    for _ in range(30):
        proposal = sampler.ask()
        sampler.tell(told(proposal))
        demands = preflight(proposal.u).demands[list(VARYING)]
        heavy += (usual < demands).mean(axis=0) > 0.9
    assert heavy.min() >= 7  # evenly drawn it were three
    assert heavy.max() < 2.5 * heavy.min()


def test_a_demand_that_many_scenes_bring_to_its_most_does_not_hold_up_the_others():
    def limited(u):
        found = preflight(u)
        if found is not None:
            found.demands[5] = float(u[6] > 0.6)
        return found

    sampler = built("demanding", by=limited)
    usual = uniform_demands()[:, VARYING]
    heavy = []
    for _ in range(40):
        proposal = sampler.ask()
        sampler.tell(told(proposal))
        demands = preflight(proposal.u).demands[list(VARYING)]
        heavy.append((usual < demands).mean(axis=0) > 0.9)
    assert np.any(heavy[20:], axis=1).mean() > 0.6


def test_children_of_what_was_run_ask_for_more_than_was_ever_drawn():
    sampler = built("demanding")
    most = 0.0
    for _ in range(60):
        proposal = sampler.ask()
        sampler.tell(told(proposal))
        most = max(most, preflight(proposal.u).demands[0])
    assert most > uniform_demands()[:, 0].max()


def test_who_weighs_scenes_chooses_three_in_four_of_them_once_there_are_results():
    sampler = built("demanding")
    asked = []

    def weigh(points):
        asked.append(points)
        return points[:, 1]

    sampler.weigh_by(weigh)
    for _ in range(60):
        before = len(asked)
        proposal = sampler.ask()
        if len(asked) > before:
            np.testing.assert_array_equal(proposal.u, max(asked[-1], key=lambda u: u[1]))
        sampler.tell(told(proposal))
    assert 28 <= len(asked) <= 46
    assert {points.shape for points in asked} == {(len(VARYING), K)}


def test_there_is_no_choice_where_no_demand_varies():
    sampler = built("demanding", by=lambda u: SceneLoads(u, np.zeros(len(DEMANDS))))
    sampler.weigh_by(lambda points: pytest.fail("asked"))
    for _ in range(30):
        sampler.tell(told(sampler.ask()))


def test_without_a_rehearsal_or_any_scene_proposals_are_uniform_and_say_so():
    for by in (None, lambda u: None):
        proposals = [built("demanding", seed=seed, by=by).ask() for seed in range(200)]
        assert all(proposal.uniform for proposal in proposals)
        points = np.array([proposal.u for proposal in proposals])
        assert abs(points.mean() - 0.5) < 0.02
    assert not built("demanding").ask().uniform


@pytest.mark.parametrize("name", ["demanding", "surrogate"])
def test_points_without_a_scene_are_not_proposed_once_scenes_are_known(name):
    sampler = built(name)
    firsts = []
    for number in range(30):
        proposal = sampler.ask()
        if number >= 12:  # `surrogate` begins with points drawn evenly
            firsts.append(proposal.u[0])
        sampler.tell(told(proposal))
    assert max(firsts) <= 0.9 or name == "surrogate"
    assert np.mean(np.array(firsts) > 0.9) < 0.1


@pytest.mark.parametrize("name", ARMS)
def test_a_search_goes_on_where_hardly_any_point_has_a_scene(name):
    sampler = built(name, by=lambda u: preflight(u) if u[1] < 0.04 else None)
    for _ in range(25):
        sampler.tell(told(sampler.ask()))


@pytest.mark.parametrize("name", ARMS)
def test_a_resumed_search_goes_on_as_the_first_one_did(name):
    first, resumed = built(name), built(name)
    proposals = []
    for number in range(40):
        proposal = first.ask()
        result = told(proposal, objectives={"a": float(proposal.u.mean())})
        first.tell(result)
        proposals.append(proposal.u)
        if number < 30:
            resumed.skip()
        else:
            np.testing.assert_array_equal(resumed.ask().u, proposal.u)
        resumed.tell(result)


def first_failure(sampler, fails, count):
    """Number of proposals to the first failure; margins tell nothing before it."""
    for number in range(count):
        proposal = sampler.ask()
        failed = fails(proposal.u)
        sampler.tell(
            told(
                proposal,
                objectives={"a": -0.1 if failed else 0.5},
                failed=failed,
                signature="a" if failed else "",
            )
        )
        if failed:
            return number + 1
    return count


def test_auto_finds_what_only_a_heavy_demand_shows():
    edge = np.quantile(uniform_demands(20000)[:, 0], 0.998)  # one draw in 500 is beyond

    def fails(u):
        return bool((np.abs(u - 0.5) < 0.15).sum() > edge)

    took = [first_failure(built("auto", seed), fails, 120) for seed in range(5)]
    assert np.median(took) < 80  # evenly drawn it were 350


def test_rehearsals_can_be_switched_off():
    sampler = AutoSampler(AutoSampler.Options(cube=CUBE, rehearse=False))

    def refused(u):
        raise AssertionError("looked at a scene")

    sampler.rehearse_by(refused)
    for _ in range(30):
        sampler.tell(told(sampler.ask()))


@pytest.mark.parametrize("seed", range(3))
def test_a_margin_that_follows_a_demand_is_learnt(seed):
    """The demand is a product of differences: coordinates alone tell next to nothing."""
    edge = np.quantile(uniform_demands()[:, 1], 0.99)
    sampler = SurrogateSampler(
        SurrogateSampler.Options(cube=CUBE, seed=seed, explore=0.0, loads=0.0)
    )
    sampler.rehearse_by(preflight)
    for number in range(40):
        proposal = sampler.ask()
        margin = float(edge - 100.0 * abs(proposal.u[1] - proposal.u[2])) / 100.0
        sampler.tell(told(proposal, margin, objectives={"a": margin}, failed=margin < 0.0))
        if margin < 0.0:
            assert number < 25  # evenly drawn it were one in 100
            return
    pytest.fail("not found")


def test_each_scene_is_looked_at_once():
    asked = []

    def counted(u):
        asked.append(u)
        return preflight(u)

    known = Preflights(counted)
    points = np.random.default_rng(1).random((5, K)) * 0.9
    for _ in range(3):
        assert known.demands(points).shape == (5, len(DEMANDS))
    assert len(asked) == 5


def test_climbing_comes_higher_with_each_generation_of_children():
    seen = []

    def worth(scenes):
        seen.extend(scenes)
        return values(scenes)

    def values(scenes):
        return np.array([scene.demands[0] for scene in scenes])

    known = Preflights(preflight)
    halves = np.zeros(2)
    for seed in range(5):
        seen.clear()
        random = np.random.default_rng(seed)
        first = known.of(random.random((16, K)))
        best = known.climb(first, worth, Mutator(CUBE), random=random, looks=60)
        assert seen[: len(first)] == first
        children = seen[len(first) :]
        assert 30 < len(children) <= 60  # some have no scene
        assert values(children).max() > values(first).max()
        assert best.demands[0] == values(children).max()
        halves += [values(children[:20]).mean(), values(children[-20:]).mean()]
    assert halves[1] > halves[0] + 5.0  # one more coordinate each time


def test_scenes_that_were_run_have_children_but_are_not_found_again():
    def worth(scenes):
        return np.array([scene.demands[0] for scene in scenes])

    known = Preflights(preflight)
    random = np.random.default_rng(0)
    first = known.of(random.random((4, K)))
    run = known.of([np.full(K, 0.5)])  # nothing is worth more
    for looks in (0, 40):
        best = known.climb(first, worth, Mutator(CUBE), random=random, looks=looks, others=run)
        assert best is not run[0]
    assert worth([best])[0] > worth(first).max()


def test_demands_are_scaled_by_those_known_and_what_says_nothing_is_zero():
    among = np.array([[0.0, 7.0], [2.0, 7.0], [np.nan, np.nan]])
    scaled = standardised(np.array([[3.0, 9.0], [np.nan, np.nan]]), among)
    np.testing.assert_allclose(scaled, [[2.0, 0.0], [0.0, 0.0]])
    np.testing.assert_array_equal(standardised(among, np.empty((0, 2))), np.zeros((3, 2)))


def test_a_demanding_proposal_is_frozen_and_numbered():
    sampler = DemandingSampler(DemandingSampler.Options(cube=CUBE, seed=1))
    sampler.rehearse_by(preflight)
    for number in range(5):
        proposal = sampler.ask()
        assert proposal.number == number
        assert not proposal.u.flags.writeable
