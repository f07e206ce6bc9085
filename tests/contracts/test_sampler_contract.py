"""What every sampler must do, whatever its method."""

from __future__ import annotations

import importlib.util
import random

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.candidate import Dimension, SearchSpace
from mrta_falsify.core.config import Choice
from mrta_falsify.core.feedback import Cube, Feedback, cube_of
from mrta_falsify.core.protocols import SkippingSampler
from mrta_falsify.core.seeding import stream

OPTIONAL = {"map_elites": "ribs", "verifai_ce": "verifai"}
NAMES = tuple(
    name
    for name in registry.names("sampler")
    if name not in OPTIONAL or importlib.util.find_spec(OPTIONAL[name])
)
CUBE = {
    "dimensions": 7,
    "levels": [0, 0, 3, 0, 6, 0, 40],
    "groups": [0, 0, 0, 1, 1, 2, 3],
    "kin": [0, 1, 2, 0, 3, 0, 4],
}


#: Samplers that fit a model at each proposal. ``make test`` takes ``FEW`` proposals of them, with
#: these options, so that the model is reached; ``make long`` takes as many as of the others.
MODEL_BASED = {"auto": {}, "tpe": {"initial": 4}}
FEW = 16


def cases(many, names=NAMES):
    """Pairs of sampler and number of proposals."""
    few = [pytest.param(name, FEW if name in MODEL_BASED else many) for name in names]
    return few + [
        pytest.param(name, many, marks=pytest.mark.long) for name in names if name in MODEL_BASED
    ]


def build(name, cube=CUBE, seed=5, *, count=1):
    """A sampler of which ``count`` proposals are taken."""
    sooner = MODEL_BASED.get(name, {}) if count <= FEW else {}
    return registry.build("sampler", Choice(name, {"cube": cube, "seed": seed, **sooner}))


def result(proposal, *, flat=False):
    """A plausible result: one in six rejected, repaired a little, several objectives."""
    chance = stream(proposal.number, "test/result")
    if chance.random() < 1 / 6:
        return Feedback(number=proposal.number, u=proposal.u, fate="rejected")
    u = np.array(proposal.u)
    if len(u):
        u[0] = 0.5 * u[0] + 0.25  # as if repaired
    score = 1.0 if flat else float(np.sum((u - 0.2) ** 2)) - 0.05
    return Feedback(
        number=proposal.number,
        u=u,
        score=score,
        objectives={"a": score, "b": 1.0 if flat else float(u.mean()) if len(u) else 0.0},
        descriptors={
            "x": float(chance.random()),
            "cause": 0.5,
            "robots": 0.3,
            "queue": 0.0 if flat or not len(u) else float(u[-1]),
        },
        failed=score < 0.0,
        signature="no_deadlock/2" if score < 0.0 else "",
    )


def drive(sampler, count, *, window=1, flat=False):
    """Proposals of a search whose results come ``window`` late."""
    asked = []
    told = 0
    for _ in range(count):
        asked.append(sampler.ask())
        if len(asked) - told >= window:
            sampler.tell(result(asked[told], flat=flat))
            told += 1
    return asked


@pytest.mark.parametrize(("name", "count"), cases(90))
@pytest.mark.parametrize("window", [1, 8])
def test_proposals_are_numbered_frozen_and_in_the_cube(name, count, window):
    for i, proposal in enumerate(drive(build(name, count=count), count, window=window)):
        assert proposal.number == i
        assert proposal.u.shape == (7,)
        assert proposal.u.min() >= 0.0
        assert proposal.u.max() <= 1.0
        assert not proposal.u.flags.writeable


@pytest.mark.parametrize(("name", "count"), cases(70))
def test_asking_and_telling_again_gives_the_same_proposals(name, count):
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002 - proves that global state plays no part
    first = [proposal.u for proposal in drive(build(name, count=count), count, window=4)]
    random.seed(2)
    np.random.seed(2)  # noqa: NPY002
    second = [proposal.u for proposal in drive(build(name, count=count), count, window=4)]
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("name", NAMES)
def test_seeds_differ(name):
    one, other = (drive(build(name, seed=seed), 1)[0].u for seed in (1, 2))
    assert (one != other).any()


@pytest.mark.parametrize(("name", "count"), cases(45))
@pytest.mark.parametrize("dimensions", [0, 1, 300])
def test_any_number_of_dimensions_will_do(name, count, dimensions):
    sampler = build(name, {"dimensions": dimensions}, count=count)
    proposals = drive(sampler, count, window=3)
    assert all(proposal.u.shape == (dimensions,) for proposal in proposals)


@pytest.mark.parametrize(("name", "count"), cases(80))
def test_a_flat_score_does_not_stop_the_search_from_moving(name, count):
    points = np.array([p.u for p in drive(build(name, count=count), count, window=2, flat=True)])
    assert len(np.unique(points.round(9), axis=0)) > 70 * count / 80
    assert points[count // 2 :].std(axis=0).max() > 0.05


@pytest.mark.parametrize("name", NAMES)  # no model learns from rejections
def test_nothing_but_rejections_does_not_stop_it_either(name):
    sampler = build(name)
    points = []
    for _ in range(60):
        proposal = sampler.ask()
        points.append(proposal.u)
        sampler.tell(Feedback(number=proposal.number, u=proposal.u, fate="rejected"))
    assert len(np.unique(np.array(points).round(9), axis=0)) > 50


# VerifAI's learns from violations alone, splitting from levels: neither climbs a slope
SPREADING = {"random", "halton", "sobol", "splitting", "verifai_ce"}
LEARNERS = sorted(set(NAMES) - SPREADING)


@pytest.mark.parametrize(
    ("name", "seeds", "count"),
    [
        *(pytest.param(name, 1, 40, marks=pytest.mark.slow) for name in MODEL_BASED),
        *(
            pytest.param(name, 3, 200, marks=pytest.mark.long if name in MODEL_BASED else ())
            for name in LEARNERS
        ),
    ],
)
def test_those_that_learn_do_better_than_chance_on_a_smooth_score(name, seeds, count):
    cube = {"dimensions": 12}

    def best_of(sampler):
        scores = [np.inf]
        for _ in range(count):
            proposal = sampler.ask()
            score = float(((proposal.u - 0.3) ** 2).sum())
            scores.append(score)
            margins = {"a": score, "b": 1.0}
            where = {"x": float(proposal.u[0]), "y": float(proposal.u[1]), "robots": 0, "cause": 0}
            sampler.tell(
                Feedback(number=proposal.number, u=proposal.u, score=score, objectives=margins,
                         descriptors=where)
            )  # fmt: skip
        return min(scores)

    learned = np.median([best_of(build(name, cube, seed)) for seed in range(seeds)])
    chance = np.median([best_of(build("random", cube, seed)) for seed in range(seeds)])
    assert learned < 0.8 * chance


def test_the_cube_of_a_space_knows_objects_and_levels():
    space = SearchSpace(
        dimensions=(
            Dimension(name="bed_1.position.0", kind="point"),
            Dimension(name="bed_1.position.1", kind="point"),
            Dimension(name="tasks[0][1]", kind="integer", choices=6),
            Dimension(name="bed_1.yaw", kind="range"),
            Dimension(name="param layout.door_width[0]", kind="range"),
            Dimension(name="param layout.door_width[1]", kind="range"),
            Dimension(name="tasks[1][1]", kind="integer", choices=6),
            Dimension(name="tasks[2][1]", kind="integer", choices=5),
            Dimension(name="tasks[0][2]", kind="choice", choices=2, values=("3", "'lift'")),
            Dimension(name="tasks[1][2]", kind="choice", choices=3, values=("4", "'lift'", "3")),
        )
    )
    assert cube_of(space) == Cube(
        dimensions=10,
        levels=(0, 0, 6, 0, 0, 0, 6, 5, 2, 3),
        groups=(0, 0, 1, 0, 2, 3, 4, 5, 6, 7),
        owners=(
            "bed_1",
            "tasks[0][1]",
            "param layout.door_width[0]",
            "param layout.door_width[1]",
            "tasks[1][1]",
            "tasks[2][1]",
            "tasks[0][2]",
            "tasks[1][2]",
        ),
        kin=(0, 1, 2, 3, 4, 4, 2, 5, 6, 6),
        labels=((),) * 8 + ((0, 1), (2, 1, 0)),
    )
    assert cube_of(space).blocks() == ((0, 1, 3), (2,), (4,), (5,), (6,), (7,), (8,), (9,))
    assert cube_of(space).families() == ((2, 6), (4, 5), (8, 9))
    assert cube_of(space).labels_of(7) == (0, 1, 2, 3, 4)
    assert cube_of(space).blocks_of({"tasks[0]", "robot1"}) == (1, 6)
    assert cube_of(space).blocks_of({"bed_1", "tasks[0][1]", "bed"}) == (0, 1)


SKIPPING = [name for name in NAMES if isinstance(build(name), SkippingSampler)]


@pytest.mark.parametrize(("name", "count"), cases(70, SKIPPING))
def test_skipped_proposals_change_nothing_in_later_ones(name, count):
    asked = drive(build(name, count=count), count)
    skipping, first = build(name, count=count), count * 6 // 7
    for proposal in asked[:first]:
        skipping.skip()
        skipping.tell(result(proposal))
    later = [proposal.u for proposal in drive_on(skipping, asked[first:])]
    np.testing.assert_array_equal(later, [proposal.u for proposal in asked[first:]])


def drive_on(sampler, expected):
    """Further proposals, told as they come."""
    for proposal in expected:
        yield sampler.ask()
        sampler.tell(result(proposal))
