"""What the models of the surrogate sampler learn."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.probability import chance_of_failure
from mrta_falsify.core.seeding import stream
from mrta_falsify.perturbed_runs import expected_margin
from samplers.surrogate import SurrogateSampler


def drive(sampler, margin_of, count):
    """Results of ``count`` proposals; the margin is a function of the point."""
    told = []
    for _ in range(count):
        proposal = sampler.ask()
        margin = float(np.clip(margin_of(proposal.u), -1.0, 1.0))
        told.append(
            Feedback(
                number=proposal.number,
                u=proposal.u,
                score=margin,
                objectives={"deadlines": margin, "no_deadlock": 1.0},
                failed=margin < 0.0,
                signature="deadlines/1" if margin < 0.0 else "",
            )
        )
        sampler.tell(told[-1])
    return told


def slope(seed, dimensions):
    """A margin that falls along a random direction, below 0 for one uniform point in 200."""
    random = stream(seed, "test/slope")
    weights = random.normal(size=dimensions)
    values = random.random((4000, dimensions)) @ weights
    edge = np.quantile(values, 0.005)
    return lambda u: float(u @ weights - edge) / 6.0


@pytest.mark.parametrize("seed", range(4))
def test_a_slope_in_twenty_dimensions_is_learnt_from_a_few_dozen_results(seed):
    cube = Cube(dimensions=20, groups=tuple(i // 2 for i in range(20)))
    sampler = SurrogateSampler(SurrogateSampler.Options(cube=cube, seed=seed))
    told = drive(sampler, slope(seed, 20), 45)
    assert any(result.failed for result in told)


@pytest.mark.parametrize("seed", range(3))
def test_what_few_objects_of_one_kind_decide_is_learnt_among_many_of_another(seed):
    """Six tasks decide, twenty people with three coordinates each do not."""
    people = [f"human{i}" for i in range(20)]
    tasks = [f"tasks[{i}]" for i in range(6)]
    cube = Cube(
        dimensions=66,
        groups=(*np.repeat(np.arange(20), 3).tolist(), *range(20, 26)),
        owners=(*people, *tasks),
    )
    sampler = SurrogateSampler(SurrogateSampler.Options(cube=cube, seed=seed))
    of_tasks = slope(seed, 6)
    told = drive(sampler, lambda u: of_tasks(u[60:]), 45)
    assert sum(result.failed for result in told) > 25  # half of it where kinds are not known


def test_a_discrete_coordinate_is_learnt_by_its_levels():
    cube = Cube(dimensions=4, levels=(6, 0, 0, 0))

    def margin(u):
        return 0.5 - 0.6 * (int(u[0] * 6) == 3) + 0.2 * (u[1] - 0.5)

    sampler = SurrogateSampler(SurrogateSampler.Options(cube=cube, seed=2))
    told = drive(sampler, margin, 60)
    late = [int(result.u[0] * 6) for result in told[30:]]
    assert late.count(3) > 0.6 * len(late)


def test_failures_that_are_known_are_not_proposed_again():
    cube = Cube(dimensions=3)
    sampler = SurrogateSampler(SurrogateSampler.Options(cube=cube, seed=0))
    told = drive(sampler, lambda u: float(u[0] - 0.3), 80)
    failed = np.array([result.u for result in told if result.failed])
    apart = np.linalg.norm(failed[:, None] - failed[None], axis=2)
    nearest = (apart + 9.0 * np.eye(len(failed))).min(axis=1)
    assert len(failed) > 30
    assert np.median(nearest) > 0.05


def test_no_more_results_than_asked_for_are_in_the_models():
    cube = Cube(dimensions=3)
    sampler = SurrogateSampler(SurrogateSampler.Options(cube=cube, seed=0, memory=20))
    drive(sampler, lambda u: float(u.sum()), 90)
    assert len(sampler.results()) <= 20


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_other_failures_are_looked_for_once_one_is_known(seed):
    sampler = SurrogateSampler(SurrogateSampler.Options(cube=Cube(dimensions=8), seed=seed))
    found = []
    for number in range(80):
        u = np.array(sampler.ask().u)
        margins = {
            "often": 0.8 - u[0] + 0.1 * (u[2] - 0.5),
            "seldom": 0.95 - u[1] - 0.2 * u[3],
            "together": 0.75 - u[4] * u[5],
        }
        violated = [name for name, margin in margins.items() if margin < 0.0]
        found += violated[:1]
        feedback = Feedback(
            number=number,
            u=u,
            fate="judged",
            score=min(margins.values()),
            objectives=margins,
            failed=bool(violated),
            signature="".join(violated[:1]),
        )
        sampler.tell(feedback)
    assert set(found) == {"often", "seldom", "together"}


def robust_failures(seed: int) -> int:
    """Search ten waves and five of their products under a rough field that copies do not share."""
    dimensions = 48
    random = stream(seed, "test/rough")
    chosen = random.permutation(dimensions)[:10]
    weights, shifts = random.normal(size=10), random.uniform(0.0, 2.0 * np.pi, 10)
    pairs = random.integers(10, size=(5, 2))
    rough_waves = random.normal(size=(dimensions, 200)) / 0.35
    own_phases = random.uniform(0.0, 2.0 * np.pi, 200)

    def smooth(u):
        waves = np.sin(np.pi * u[..., chosen] + shifts)
        products = waves[..., pairs[:, 0]] * waves[..., pairs[:, 1]]
        return waves @ weights + 0.7 * products.sum(axis=-1)

    uniform = smooth(random.random((20_000, dimensions)))
    edge, spread = np.quantile(uniform, 0.003), uniform.std()

    def margin(u, phases):
        rough = 0.1 * float(np.cos(u @ rough_waves + phases).sum())
        value = 0.1 * (float(smooth(u) - edge) / spread + rough)
        return max(value, -0.025)  # ended soon after the violation

    cube = Cube(dimensions=dimensions, groups=tuple(i // 4 for i in range(dimensions)))
    sampler = SurrogateSampler(SurrogateSampler.Options(cube=cube, seed=seed, robust=True))
    robust = 0
    for number in range(120):
        u = np.array(sampler.ask().u)
        margins = [margin(u, own_phases)]
        if margins[0] < 0.0:
            margins += [margin(u, random.uniform(0.0, 2.0 * np.pi, 200)) for _ in range(4)]
        failed = sum(value < 0.0 for value in margins[1:])
        robust += failed > 2
        told = expected_margin(margins)
        feedback = Feedback(
            number=number,
            u=u,
            fate="judged",
            score=-chance_of_failure(failed, 4).mean if margins[0] < 0.0 else margins[0],
            objectives={"deadlines": told.mean},
            failed=failed > 2,
            signature="deadlines/1" if failed > 2 else "",
        )
        sampler.tell(feedback)
    return robust


@pytest.mark.long
def test_knife_edges_do_not_hold_the_search():
    assert sum(map(robust_failures, range(4))) > 4 * 9
