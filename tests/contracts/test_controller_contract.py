"""What every registered controller, dynamics, priority rule and human model must do."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from mrta_falsify.core.config import Choice
from mrta_falsify.core.protocols import (
    Controller,
    ControlView,
    CrowdView,
    HumanModel,
    PriorityRule,
    PriorityView,
)
from mrta_falsify.core.registry import build, names


def random_view(rng, n, h, k=0):
    """A plausible tick of ``n`` robots and ``h`` people; some links down, some robots idle."""
    pose = np.column_stack((rng.uniform(0, 6, (n, 2)), rng.uniform(-3, 3, n)))
    velocity = np.zeros((n, 3))
    velocity[:, 0] = rng.uniform(-0.2, 1.0, n)
    wants = rng.uniform(size=n) < 0.7
    goal = np.where(wants[:, None], rng.uniform(0, 6, (n, 2)), np.nan)
    path = tuple(
        np.linspace(pose[i, :2], goal[i], 20) if wants[i] else np.zeros((0, 2)) for i in range(n)
    )
    target = np.array([p[3] if len(p) else [np.nan, np.nan] for p in path]).reshape(n, 2)
    points = pose[:, None, :2] + rng.uniform(-3, 3, (n, 12, 2))
    points[rng.uniform(size=(n, 12)) < 0.3] = np.inf
    return ControlView(
        time=0.05 * k,
        dt=0.05,
        pose=pose,
        velocity=velocity,
        target=target,
        goal=goal,
        path=path,
        active=wants & (rng.uniform(size=n) < 0.8),
        present=rng.uniform(size=n) < 0.9,
        rank=rng.permutation(n),
        obstacle_points=points,
        human_position=rng.uniform(0, 6, (h, 2)),
        human_velocity=rng.uniform(-1, 1, (h, 2)),
        human_radius=np.full(h, 0.25),
        states_link=rng.uniform(size=n) < 0.9,
        leader_link=rng.uniform(size=n) < 0.9,
        max_speed=np.full(n, 1.5),
        max_acceleration=np.full(n, 1.0),
        max_turn_rate=np.full(n, 2.0),
    )


@pytest.mark.parametrize("name", names("controller"))
class TestController:
    @pytest.mark.parametrize(("n", "h"), [(0, 0), (1, 0), (2, 3), (6, 8), (12, 2)])
    def test_answer_has_the_right_shapes_and_obeys_the_limits(self, name, n, h):
        rng = np.random.default_rng(n)
        controller = build("controller", Choice(name))
        assert isinstance(controller, Controller)
        for k in range(4):
            view = random_view(rng, n, h, k)
            result = controller.control(view)
            twist = result.command.twist
            assert twist.shape == (n, 3)
            assert np.isfinite(twist).all()
            assert (np.abs(twist[:, :2]) <= 1.5 + 1e-9).all()
            assert (np.abs(twist[:, 2]) <= 2.0 + 1e-9).all()
            assert (twist[~view.present] == 0.0).all()
            for field in (result.cluster, result.leader, result.slack, result.fallback):
                assert field.shape == (n,)
            assert (result.slack >= 0).all()
            assert (result.cluster <= np.arange(n)).all()
            assert not result.fallback.any()

    def test_robot_without_a_target_brakes(self, name):
        view = random_view(np.random.default_rng(1), 1, 0)
        alone = build("controller", Choice(name))
        free = {
            "target": np.full((1, 2), np.nan),
            "goal": np.full((1, 2), np.nan),
            "path": (np.zeros((0, 2)),),
            "velocity": np.array([[0.8, 0.0, 0.0]]),
            "obstacle_points": np.full((1, 12, 2), np.inf),
            "present": np.ones(1, dtype=bool),
            "states_link": np.ones(1, dtype=bool),
            "leader_link": np.ones(1, dtype=bool),
        }
        values = {f: free.get(f, getattr(view, f)) for f in ControlView.__dataclass_fields__}
        twist = alone.control(ControlView(**values)).command.twist
        np.testing.assert_allclose(twist, [[0.75, 0.0, 0.0]], atol=1e-6)

    def test_copy_goes_on_exactly_like_the_original(self, name):
        rng = np.random.default_rng(5)
        views = [random_view(rng, 6, 8, k) for k in range(12)]
        controller = build("controller", Choice(name))
        for view in views[:6]:
            controller.control(view)
        copied = copy.deepcopy(controller)
        first = [controller.control(view).command.twist.tobytes() for view in views[6:]]
        second = [copied.control(view).command.twist.tobytes() for view in views[6:]]
        assert first == second

    def test_input_arrays_are_left_alone(self, name):
        view = random_view(np.random.default_rng(2), 4, 3)
        kept = copy.deepcopy(view)
        build("controller", Choice(name)).control(view)
        for field in ControlView.__dataclass_fields__:
            if field != "path":
                np.testing.assert_array_equal(getattr(view, field), getattr(kept, field))


@pytest.mark.parametrize("name", names("dynamics"))
def test_dynamics_drives_every_controller(name):
    for controller in names("controller"):
        built = build("controller", Choice(controller, {"dynamics": name}))
        result = built.control(random_view(np.random.default_rng(3), 5, 2))
        assert np.isfinite(result.command.twist).all()


@pytest.mark.parametrize("name", names("priority_rule"))
def test_priority_rule_gives_a_permutation(name):
    rule = build("priority_rule", Choice(name))
    assert isinstance(rule, PriorityRule)
    view = PriorityView(
        time=3.0,
        pose=np.zeros((5, 3)),
        active=np.array([True, False, True, False, True]),
        distance_to_goal=np.array([3.0, np.inf, 1.0, np.inf, 3.0]),
        waiting_since=np.full(5, np.inf),
    )
    assert sorted(rule.ranks(view).tolist()) == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(rule.ranks(view), copy.deepcopy(rule).ranks(view))


@pytest.mark.parametrize("name", names("human_model"))
@pytest.mark.parametrize("h", [0, 1, 8])
def test_human_model_gives_finite_velocities_and_moves_nobody_who_is_absent(name, h):
    rng = np.random.default_rng(h)
    model = build("human_model", Choice(name))
    assert isinstance(model, HumanModel)
    view = CrowdView(
        dt=0.05,
        position=rng.uniform(0, 3, (h, 2)),
        velocity=rng.uniform(-1, 1, (h, 2)),
        target=rng.uniform(0, 3, (h, 2)),
        desired_speed=rng.uniform(0, 1.3, h),
        radius=np.full(h, 0.25),
        reacts_to_robots=rng.uniform(size=h) < 0.6,
        present=np.arange(h) != 0,
        robot_position=rng.uniform(0, 3, (3, 2)),
        robot_velocity=np.zeros((3, 2)),
        robot_radius=np.full(3, 0.22),
        walls=np.array([[0.0, 0.0, 3.0, 0.0]]),
    )
    velocity = model.velocities(view)
    assert velocity.shape == (h, 2)
    assert np.isfinite(velocity).all()
    assert (np.hypot(velocity[:, 0], velocity[:, 1]) <= 2.0).all()
    assert (velocity[:1] == 0).all()
