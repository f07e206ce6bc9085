"""Policies from files, and what they see."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.registry import build
from mrta_falsify.stack.policy.observation import PARTS, SIGHT, SIZE, bounds, observe, twists_of
from mrta_falsify.stack.policy.policy_file import load_policy
from tests.contracts.test_controller_contract import random_view

CONTROLLER = "mrta_falsify.stack.policy.policy_controller:PolicyController"


@pytest.fixture
def view():
    return random_view(np.random.default_rng(4), 3, 2)


def weights(path, **changes):
    random = np.random.default_rng(1)
    arrays = {
        "weight_0": random.normal(size=(5, SIZE)),
        "bias_0": np.zeros(5),
        "weight_1": random.normal(size=(2, 5)),
        "bias_1": np.zeros(2),
    }
    arrays |= changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return str(path)


@pytest.mark.parametrize(("n", "h"), [(0, 0), (1, 0), (2, 3), (7, 8)])
def test_an_observation_has_one_shape_and_keeps_within_its_bounds(n, h):
    seen = observe(random_view(np.random.default_rng(n), n, h))
    assert seen.shape == (n, SIZE)
    assert seen.dtype == np.float32
    low, high = bounds()
    assert (seen >= low).all()
    assert (seen <= high).all()


def test_a_robot_sees_points_robots_and_people_where_they_are(view):
    view = dataclasses.replace(
        view,
        pose=np.array([[1.0, 1.0, np.pi / 2], [1.0, 3.0, 0.0], [9.0, 9.0, 0.0]]),
        velocity=np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        target=np.array([[0.0, 1.0], [np.nan, np.nan], [9.5, 9.0]]),
        present=np.ones(3, dtype=bool),
        states_link=np.ones(3, dtype=bool),
        human_position=np.array([[2.0, 1.0], [np.inf, np.inf]]),
        human_velocity=np.array([[0.0, 1.0], [0.0, 0.0]]),
        human_radius=np.array([0.25, 0.25]),
        obstacle_points=np.full((3, 12, 2), np.inf),
    )
    view.obstacle_points[0, 0] = (1.0, 2.5)
    seen = {name: observe(view)[0][place] for name, place in PARTS.items()}
    assert seen["target"] == pytest.approx([0.0, 1.0])  # to its left
    assert seen["obstacles"][0] == pytest.approx(1.5)  # straight ahead
    assert (seen["obstacles"][1:] == SIGHT).all()
    assert seen["robots"][:5] == pytest.approx([2.0, 0.0, 0.0, -0.5, 1.0], abs=1e-6)
    assert not seen["robots"][5:].any()  # the third is out of sight
    assert seen["people"][:6] == pytest.approx([0.0, -1.0, 1.0, 0.0, 0.25, 1.0], abs=1e-6)
    assert not seen["people"][6:].any()  # the second is not in the building


def test_actions_are_shares_of_a_robots_limits_and_who_has_not_joined_stands(view):
    view = dataclasses.replace(view, present=np.array([True, True, False]))
    twist = twists_of(np.array([[0.5, -1.0], [7.0, 0.0], [1.0, 1.0]]), view)
    assert twist.tolist() == [[0.75, 0.0, -2.0], [1.5, 0.0, 0.0], [0.0, 0.0, 0.0]]


def test_weights_and_functions_drive_every_robot_by_what_it_sees(tmp_path, view):
    (tmp_path / "mine.py").write_text(
        "def fast(observation):\n    return 0.5, observation[6] * 0\n"
    )
    for file in (weights(tmp_path / "w.npz"), f"{tmp_path / 'mine.py'}:fast"):
        policy = load_policy(file)
        result = build("controller", Choice(CONTROLLER, {"file": file})).control(view)
        wanted = twists_of(np.array([policy(one) for one in observe(view)]), view)
        assert result.command.twist.tobytes() == wanted.tobytes()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weight_0": None}, "has no weight_0"),
        ({"bias_1": None}, "has no bias_1"),
        ({"bias_0": np.zeros(4)}, r"bias_0 has shape \(4,\); it must be \(5,\)"),
        ({"weight_1": np.zeros((3, 5))}, r"weight_1 has shape \(3, 5\); it must be \(2, 5\)"),
        ({"scale": np.zeros(SIZE)}, "scale has a 0"),
        ({"mean": np.full(SIZE, np.nan)}, "mean is not finite"),
        ({"bias_0": np.array([None] * 5, dtype=object)}, "must be numbers"),
    ],
)
def test_weights_that_are_none_are_refused_and_pickles_are_not_read(tmp_path, changes, message):
    with pytest.raises(FormatError, match=message):
        load_policy(weights(tmp_path / "w.npz", **changes))


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("policy.pkl", "must be FILE.py, FILE.py:NAME or FILE.npz"),
        ("nowhere.py", "there is no such file"),
        ("empty.py", "has no function 'act'"),
        ("broken.py", "cannot be loaded: ZeroDivisionError"),
        ("text.npz", "is no archive of numbers"),
    ],
)
def test_files_without_a_policy_are_refused(tmp_path, file, message):
    (tmp_path / "empty.py").write_text("")
    (tmp_path / "broken.py").write_text("1 / 0\n")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(FormatError, match=message):
        load_policy(str(tmp_path / file))
