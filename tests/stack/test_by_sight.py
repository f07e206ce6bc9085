"""People who walk by sight, beside published measurements."""

from __future__ import annotations

import numpy as np
import pytest
from test_humans import by_sight, crowd


def walk(position, target, seconds=12.0, **changes):
    """Tracks ``(K, H, 2)``."""
    model, tracks, velocity = by_sight(), [np.array(position, dtype=float)], None
    for _ in range(round(seconds / 0.05)):
        more = {} if velocity is None else {"velocity": velocity}
        velocity = model.velocities(crowd(tracks[-1], target, **changes, **more))
        tracks.append(tracks[-1] + 0.05 * velocity)
    return np.array(tracks)


LENGTH, WIDTH = 12.0, 2.4  # m, of a corridor whose ends meet


def stream_speed(density, *, both_ways=False, seconds=25.0):
    """Mean speed along a corridor [m/s], of people spread evenly over it at first."""
    random = np.random.default_rng(7)
    columns = 3
    rows = round(density * LENGTH * WIDTH / columns)
    along, across = np.meshgrid(np.arange(rows) * LENGTH / rows, (-0.7, 0.0, 0.7))
    position = np.stack([along.ravel(), across.ravel()], axis=1)
    position += random.uniform(-0.05, 0.05, position.shape)
    count = len(position)
    forward = np.where(both_ways & (random.random(count) < 0.5), -1.0, 1.0)
    desired = np.clip(random.normal(1.34, 0.15, count), 0.9, 1.8)
    walls = np.array([(-30, y, 30 + LENGTH, y) for y in (-WIDTH / 2, WIDTH / 2)])
    model, velocity, speeds = by_sight(), np.zeros_like(position), []
    for tick in range(round(seconds / 0.05)):
        shown = np.concatenate([position + np.array([k * LENGTH, 0.0]) for k in (0, 1, -1)])
        target = shown + np.tile(np.stack([3.0 * forward, 0.0 * forward], axis=1), (3, 1))
        view = crowd(
            shown, target, velocity=np.tile(velocity, (3, 1)), desired_speed=np.tile(desired, 3),
            walls=walls,
        )  # fmt: skip
        velocity = np.asarray(model.velocities(view))[:count]
        position = position + 0.05 * velocity
        position[:, 0] %= LENGTH
        if tick * 0.05 > 0.5 * seconds:
            speeds.append((velocity[:, 0] * forward).mean())
    return float(np.mean(speeds))


@pytest.mark.parametrize("density", [0.5, 1.0, 1.5])
def test_people_in_a_stream_slow_down_as_measured(density):
    """Weidmann 1993; three people abreast are few, so the bound is wider than on average."""
    published = 1.34 * (1.0 - np.exp(-1.913 * (1.0 / density - 1.0 / 5.4)))
    assert stream_speed(density) == pytest.approx(published, rel=0.2)


def test_streams_that_meet_do_not_jam():
    published = 1.34 * (1.0 - np.exp(-1.913 * (1.0 - 1.0 / 5.4)))
    assert stream_speed(1.0, both_ways=True) > 0.75 * published


@pytest.mark.parametrize("beside", [-0.1, 0.0, 0.1])
def test_people_who_meet_in_a_corridor_leave_room(beside):
    walls = np.array([(-12.0, -1.2, 12.0, -1.2), (-12.0, 1.2, 12.0, 1.2)])
    tracks = walk([(-6, 0), (6, beside)], [(9, 0), (-9, beside)], 9.0, walls=walls)
    gap = np.linalg.norm(tracks[:, 0] - tracks[:, 1], axis=1) - 0.5
    assert gap.min() > 0.1


@pytest.mark.parametrize("beside", [-0.2, 0.0, 0.2])
def test_people_pass_a_standing_robot_at_a_distance(beside):
    tracks = walk([(-6, 0)], [(6, 0)], robots=[(0, beside)])
    gap = np.linalg.norm(tracks[:, 0] - [0, beside], axis=1) - 0.25 - 0.22
    assert gap.min() > 0.3


def test_a_person_waits_behind_a_robot_that_fills_the_corridor():
    walls = np.array([(-12.0, -0.5, 12.0, -0.5), (-12.0, 0.5, 12.0, 0.5)])
    tracks = walk([(-4, 0)], [(4, 0)], robots=[(0, 0)], walls=walls)
    gap = np.linalg.norm(tracks[:, 0], axis=1) - 0.25 - 0.22
    assert gap.min() > 0.0
    assert tracks[-1, 0, 0] < -0.4
