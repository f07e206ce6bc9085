"""How people walk."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from control_course import box, edge_distance

from mrta_falsify.core.protocols import CrowdView
from mrta_falsify.stack.by_sight import BySight


def crowd(position, target, **changes):
    position = np.array(position, dtype=float).reshape(-1, 2)
    h = len(position)
    robots = np.array(changes.pop("robots", np.zeros((0, 2))), dtype=float).reshape(-1, 2)
    values = {
        "dt": 0.05,
        "position": position,
        "velocity": np.zeros((h, 2)),
        "target": np.array(target, dtype=float).reshape(-1, 2),
        "desired_speed": np.ones(h),
        "radius": np.full(h, 0.25),
        "reacts_to_robots": np.ones(h, dtype=bool),
        "present": np.ones(h, dtype=bool),
        "robot_position": robots,
        "robot_velocity": np.zeros_like(robots),
        "robot_radius": np.full(len(robots), 0.22),
        "walls": np.zeros((0, 4)),
    }
    values.update(changes)
    return CrowdView(**values)


def by_sight():
    return BySight(BySight.Options())


def walk(position, target, seconds=20.0, **changes):
    """Tracks ``(K, H, 2)`` until everyone has arrived."""
    model = by_sight()
    view = crowd(position, target, **changes)
    tracks = [view.position]
    for _ in range(round(seconds / view.dt)):
        velocity = model.velocities(view)
        position = view.position + velocity * view.dt
        tracks.append(position)
        view = crowd(position, target, **{**changes, "velocity": velocity})
        if (np.linalg.norm(position - view.target, axis=1) < 0.3).all():
            break
    return np.array(tracks)


def test_person_reaches_the_desired_speed_and_goes_straight():
    tracks = walk([(0, 0)], [(5, 0)])
    speed = np.linalg.norm(np.diff(tracks[:, 0], axis=0), axis=1) / 0.05
    assert speed.max() == pytest.approx(1.0, abs=0.02)
    assert np.abs(tracks[:, 0, 1]).max() < 1e-9


@pytest.mark.parametrize("walls", [[], [(-9, -1, 9, -1), (-9, 1, 9, 1)]], ids=["open", "corridor"])
def test_two_people_pass_each_other_on_the_right(walls):
    walls = np.array(walls, dtype=float).reshape(-1, 4)
    tracks = walk([(-3, 0), (3, 0)], [(3, 0), (-3, 0)], walls=walls)
    assert np.linalg.norm(tracks[-1] - [[3, 0], [-3, 0]], axis=1).max() < 0.35
    gap = np.linalg.norm(tracks[:, 0] - tracks[:, 1], axis=1)
    assert gap.min() > 0.6
    assert tracks[gap.argmin(), 0, 1] < 0  # walks east, passes south


def test_person_goes_round_a_robot_only_if_it_reacts():
    tracks = walk([(-3, 0)], [(3, 0)], robots=[(0, 0)])
    assert np.linalg.norm(tracks[:, 0], axis=1).min() > 0.47
    blind = walk([(-3, 0)], [(3, 0)], robots=[(0, 0)], reacts_to_robots=np.zeros(1, dtype=bool))
    assert np.linalg.norm(blind[:, 0], axis=1).min() < 0.05


def test_person_passes_a_door_of_ninety_centimetres():
    walls = np.array(box(-0.1, 0.45, 0.1, 5) + box(-0.1, -5, 0.1, -0.45))
    tracks = walk([(-3, 0.6)], [(3, -0.5)], walls=walls)
    assert np.linalg.norm(tracks[-1, 0] - [3, -0.5]) < 0.35
    assert edge_distance(tracks[:, 0], walls).min() > 0.249


@pytest.mark.parametrize("dt", [0.02, 0.05, 0.2])
@pytest.mark.parametrize("seed", range(6))
def test_nobody_passes_through_a_wall(seed, dt):
    rng = np.random.default_rng(seed)
    walls = np.array(box(-3, -3, 3, 3) + box(-1.2, -0.5, -0.4, 0.9) + box(1.0, -2.0, 1.1, 1.5))
    start = []
    while len(start) < 4:
        p = rng.uniform(-2.6, 2.6, 2)
        if edge_distance(p[None], walls)[0] > 0.3 and not (
            -1.2 < p[0] < -0.4 and -0.5 < p[1] < 0.9
        ):
            start.append(p)
    tracks = walk(
        start,
        rng.uniform(-9, 9, (4, 2)),
        seconds=8,
        walls=walls,
        dt=dt,
        desired_speed=np.full(4, 5.0),
        velocity=rng.uniform(-5, 5, (4, 2)),
    )
    assert np.abs(tracks).max() < 3.0
    assert min(edge_distance(t, walls).min() for t in tracks) > 0.249


def test_person_who_stands_inside_a_wall_can_walk_out():
    walls = np.array([(0.0, -2.0, 0.0, 2.0)])
    tracks = walk([(0.1, 0)], [(2, 0)], walls=walls)
    assert tracks[-1, 0, 0] > 1.6


def test_speed_is_capped_and_absent_people_do_not_move():
    view = crowd([(0, 0), (0.2, 0)], [(5, 0), (5, 0)], desired_speed=np.array([1.0, 2.0]))
    speed = np.linalg.norm(by_sight().velocities(view), axis=1)
    assert speed[0] <= 1.3 + 1e-9
    assert speed[1] <= 2.6 + 1e-9
    away = crowd([(0, 0)], [(5, 0)], present=np.zeros(1, dtype=bool))
    np.testing.assert_array_equal(by_sight().velocities(away), 0.0)


def test_model_can_be_copied_without_copying_the_walls():
    model = by_sight()
    view = crowd([(0, 0)], [(5, 0)], walls=np.array([(1.0, -1.0, 1.0, 1.0)]))
    before = model.velocities(view)
    copied = copy.deepcopy(model)
    np.testing.assert_array_equal(copied.velocities(view), before)
    assert copied._grid is model._grid
