"""Pieces of the barrier controllers: paths, clusters, dynamics, rows, programs."""

from __future__ import annotations

import numpy as np
import pytest
from control_course import Course, box, line
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.neighbours import neighbours_within
from mrta_falsify.core.polyline import look_along
from mrta_falsify.stack.control import conflicts, qp
from mrta_falsify.stack.control.barrier import (
    OBSTACLE,
    ROBOT,
    Movers,
    Rows,
    barrier_row,
    fill_pair_rows,
    input_box,
    kind_table,
    reach_of_pairs,
    room_for_rows,
)
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.grouping import connected_clusters, elect_leaders, precedence
from mrta_falsify.stack.control.perception import fill_link_loss
from mrta_falsify.stack.control.predicted_motions import SAMPLES, STEP
from mrta_falsify.stack.control.solvers import Solution
from mrta_falsify.stack.control.state import MET, SECTORS, ControllerState, remember_points

KINDS = kind_table(CbfOptions())


# --- paths ------------------------------------------------------------------------------


def ahead_of(path, position):
    """What is left of a path, and the point half a metre ahead."""
    rest, x, y, _ = look_along(path, position[0], position[1], 0.5)
    return rest, np.array([x, y])


def test_lookahead_lies_half_a_metre_away_on_the_path():
    path = np.array([[0.0, 0.0], [10.0, 0.0]])
    np.testing.assert_allclose(ahead_of(path, [2.0, 0.3])[1], [2.4, 0.0])


def test_lookahead_does_not_turn_back_to_a_part_already_driven():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    _, point = ahead_of(path, [0.9, 0.95])
    assert point[0] < 0.5
    assert point[1] == pytest.approx(1.0)


def test_lookahead_of_a_short_path_is_its_end():
    np.testing.assert_array_equal(ahead_of(np.array([[1.0, 2.0]]), np.zeros(2))[1], [1, 2])
    path = np.array([[0.0, 0.0], [1.0, 0.0]])
    np.testing.assert_array_equal(ahead_of(path, [0.9, 0.0])[1], [1, 0])


def test_the_rest_of_a_path_starts_beside_the_robot_and_keeps_the_end():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    np.testing.assert_allclose(ahead_of(path, [0.5, 0.4])[0], [[0.5, 0], [1, 0], [1, 2]])
    np.testing.assert_array_equal(ahead_of(path, [1.0, 9.0])[0], [[1, 2]])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_following_the_lookahead_always_reaches_the_end(seed):
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.uniform(-0.3, 1.0, (12, 2)), axis=0)
    position = path[0].copy()
    for _ in range(2000):
        path, point = ahead_of(path, position)
        step = point - position
        distance = np.linalg.norm(step)
        if len(path) == 1 and distance < 0.05:
            break
        position = position + step * min(1.0, 0.05 / max(distance, 1e-9))
    assert np.linalg.norm(path[-1] - position) < 0.06


# --- clusters ---------------------------------------------------------------------------


def clusters_of(position, connected):
    return connected_clusters(position, connected, 4.0, neighbours_within(position, 6.0))


def test_neighbours_of_neighbours_form_one_cluster():
    position = np.array([[0.0, 0], [3, 0], [6, 0], [20, 0], [23.9, 0]])
    label = clusters_of(position, np.ones(5, dtype=bool))
    assert label.tolist() == [0, 0, 0, 3, 3]


def test_robot_without_states_link_stays_alone_and_joins_nobody():
    position = np.array([[0.0, 0], [3, 0], [6, 0]])
    label = clusters_of(position, np.array([True, False, True]))
    assert label.tolist() == [0, 1, 2]


def test_best_ranked_active_robot_leads_and_a_suspended_one_comes_last():
    label = np.zeros(4, dtype=np.int64)
    active = np.array([False, True, True, True])
    rank = np.array([0, 1, 2, 3])
    everyone = np.ones(4, dtype=bool)
    key = precedence(active, active, np.zeros(4, dtype=bool), rank)
    assert elect_leaders(label, everyone, active, key).tolist() == [1, 1, 1, 1]
    key = precedence(active, active, np.array([False, True, False, False]), rank)
    assert elect_leaders(label, everyone, active, key).tolist() == [2, 2, 2, 2]


# --- rows -------------------------------------------------------------------------------


def row_of(position, velocity, effect, other, other_velocity, gap, kind):
    one = np.ones(1)
    movers = Movers(
        np.array([[*position, 0.0]]), velocity[None], one[None].repeat(2, 1), one, effect[None],
        one[None].repeat(2, 1), one, one, one > 0.0, np.zeros(1, np.int64),
    )  # fmt: skip
    return barrier_row(movers, 0, *other, *other_velocity, gap, kind)


@given(
    st.floats(-3, 3), st.floats(-3, 3), st.floats(-np.pi, np.pi), st.floats(-1.5, 1.5),
    st.floats(-1, 1), st.floats(-2, 2), st.floats(-1.3, 1.3), st.floats(-1.3, 1.3),
)  # fmt: skip
@settings(max_examples=100, deadline=None)
def test_row_equals_the_second_derivative_of_the_barrier(x, y, yaw, v, a, w, ox, oy):
    if np.hypot(x, y) < 0.4:
        return
    gap, (p, q) = 0.3, (2.0, 6.0)

    def h(t):
        # exact for constant acceleration and small turns: heading at half the way
        n = 400
        px, py = x, y
        for k in range(n):
            s = (k + 0.5) * t / n
            px += t / n * (v + a * s) * np.cos(yaw + w * s)
            py += t / n * (v + a * s) * np.sin(yaw + w * s)
        return (px - ox * t) ** 2 + (py - oy * t) ** 2 - gap**2

    e = 1e-3
    first, second = (h(e) - h(-e)) / (2 * e), (h(e) - 2 * h(0.0) + h(-e)) / e**2
    expected = (second + (p + q) * first + p * q * h(0.0)) / (2 * np.hypot(x, y))
    effect = np.array([[np.cos(yaw), -v * np.sin(yaw)], [np.sin(yaw), v * np.cos(yaw)]])
    r0, r1, bound, _, _ = row_of(
        np.array([x, y]), v * effect[:, 0], effect, np.zeros(2), np.array([ox, oy]), gap,
        KINDS[OBSTACLE],
    )  # fmt: skip
    assert r0 * a + r1 * w - bound == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("distance", [0.15, 0.24, 0.26, 0.29, 0.31])
@pytest.mark.parametrize("yaw", np.linspace(-np.pi, np.pi, 9))
def test_robot_at_rest_inside_its_gap_may_always_drive_away(distance, yaw):
    heading = np.array([np.cos(yaw), np.sin(yaw)])
    effect = np.array([[heading[0], 0.0], [heading[1], 0.0]])
    r0, r1, bound, ux, uy = row_of(
        np.array([distance, 0.0]), np.zeros(2), effect, np.zeros(2), np.zeros(2), 0.3,
        KINDS[OBSTACLE],
    )  # fmt: skip
    away = np.sign(heading @ [ux, uy]) or 1.0
    reachable = abs(r0) + 2 * abs(r1)
    assert r0 * away * 1.0 + r1 * 0.0 >= min(bound, 0.98 * reachable) - 1e-12


def test_inside_the_robot_gap_nobody_comes_nearer():
    effect = np.array([[1.0, 0.0], [0.0, 0.0]])
    r0, _, bound, _, _ = row_of(
        np.array([-0.55, 0.0]), np.zeros(2), effect, np.zeros(2), np.zeros(2), 0.6, KINDS[ROBOT]
    )
    assert r0 < 0
    assert bound == pytest.approx(0.0, abs=1e-12)


def test_input_box_makes_a_fast_robot_brake_at_its_limit():
    low, high = input_box(
        np.array([[1.0, 2.0]]), np.array([1.0]), np.array([-0.2]), np.array([0.5]), 0.05, True
    )
    np.testing.assert_allclose(low, [[-1, -2]])
    np.testing.assert_allclose(high, [[-1, 2]])


# --- memory of seen points --------------------------------------------------------------


def test_seen_point_is_kept_for_its_time_and_renewed_by_a_nearby_hit():
    point, seen = np.full((1, SECTORS, 2), np.inf), np.full((1, SECTORS), -np.inf)
    hit, none = np.array([[[1.0, 0.1]]]), np.full((1, 1, 2), np.inf)
    here, known = np.zeros((1, 2)), np.ones(1, dtype=bool)
    alone = neighbours_within(here, MET)
    point, seen = remember_points(point, seen, hit, here, known, 0.0, 3.0, alone)
    point, seen = remember_points(point, seen, none, here, known, 2.9, 3.0, alone)
    assert np.isfinite(point[0, :, 0]).sum() == 1
    again = hit + np.array([0.05, 0.0])
    moved, _ = remember_points(point, seen, again, here, known, 2.9, 3.0, alone)
    assert np.nanmin(np.where(np.isfinite(moved[0, :, 0]), moved[0, :, 0], np.nan)) > 1.04
    point, seen = remember_points(point, seen, none, here, known, 3.1, 3.0, alone)
    assert not np.isfinite(point).any()


def test_hits_on_another_robot_are_left_to_the_pair_rows():
    point, seen = np.full((2, SECTORS, 2), np.inf), np.full((2, SECTORS), -np.inf)
    hits = np.full((2, 1, 2), np.inf)
    hits[0, 0] = [0.85, 0.0]
    position = np.array([[0.0, 0.0], [1.0, 0.0]])
    near = neighbours_within(position, MET)
    seen_points, _ = remember_points(point, seen, hits, position, np.ones(2, bool), 0.0, 3.0, near)
    assert not np.isfinite(seen_points).any()


# --- survey and manoeuvres --------------------------------------------------------------


@pytest.mark.parametrize(
    ("remote_at", "alone_before", "speed", "expected"),
    [
        (9.9, False, 0.5, [True, False, False]),  # repeats the last command
        (9.0, False, 0.5, [False, True, False]),  # which is too old now: brakes
        (9.0, False, 0.0, [False, False, True]),  # at rest: goes on by itself
        (9.0, True, 0.5, [False, False, True]),  # and stays so while it drives
        (-np.inf, False, 0.5, [False, False, True]),  # led itself all the time
    ],
)
def test_robot_without_its_leader_repeats_then_brakes_then_goes_alone(
    remote_at, alone_before, speed, expected
):
    crew = ControllerState.fresh(np.zeros((1, 3)), 0.0).crew
    crew["present"] = crew["heard"] = True
    crew["remote_at"], crew["on_its_own"] = remote_at, alone_before
    fill_link_loss(crew[0], speed, False, 10.0, 0.25)
    robot = crew[0]
    assert [bool(robot.hold), bool(robot.halted), bool(robot.on_its_own)] == expected


def conflict_of(motion, other, gap):
    """Compare each sample of ``motion`` with those of ``other`` up to half a second off."""
    held = min(gap, conflicts.KEPT_SHARE * np.linalg.norm(motion[0] - other[0]))
    for k in range(SAMPLES):
        around = other[max(0, k - conflicts.SLACK_SAMPLES) : k + conflicts.SLACK_SAMPLES + 1]
        if (((motion[k] - around) ** 2).sum(axis=1) < held * held).any():
            return k * STEP
    return np.inf


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_first_conflict_is_the_first_with_anybody(seed):
    rng = np.random.default_rng(seed)
    steps = rng.normal(scale=0.1, size=(4, SAMPLES, 2))
    one, *others = motions = np.cumsum(steps, axis=1) + rng.uniform(-1.5, 1.5, (4, 1, 2))
    box = np.empty((4, 4))
    for k, motion in enumerate(motions):
        conflicts.fill_box(motion, box[k])
    traffic = conflicts.Traffic(
        motions, box, 0.72, np.zeros((0, 2)), np.zeros(0), np.array([1, 2, 3]), np.zeros(0, int)
    )
    first, _ = conflicts.first_conflict(one, traffic)
    meets = [
        conflict_of(one, other, 0.72)
        for k, other in enumerate(others, 1)
        if not conflicts._is_followed(one, motions, k)
    ]
    assert first == min(meets, default=np.inf)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_no_inputs_can_violate_the_row_of_two_robots_beyond_reach(seed):
    rng = np.random.default_rng(seed)
    n, kind, heading = 12, KINDS[ROBOT], rng.uniform(-np.pi, np.pi, 12)
    speed, turns = rng.uniform(-0.3, 1.5, n), np.stack([np.cos(heading), np.sin(heading)], axis=1)
    aside = np.stack([-turns[:, 1], turns[:, 0]], axis=1) * speed[:, None]
    movers = Movers(
        np.column_stack([rng.uniform(0.0, 12.0, (n, 2)), heading]), speed[:, None] * turns, turns,
        speed, np.stack([turns, aside], axis=2), np.tile([1.0, 2.0], (n, 1)), np.full(n, 1.5),
        np.ones(n), np.ones(n, bool), np.zeros(n, np.int64),
    )  # fmt: skip
    found = []
    for radius in (reach_of_pairs(movers, kind, 0.6), 100.0):
        rows = room_for_rows(n, 1)
        near = neighbours_within(movers.pose, radius)
        fill_pair_rows(movers, -movers.limit, movers.limit, kind, 0.6, near, rows)
        found.append(rows.pair[: rows.pair_count[0]].tolist())
    assert found[0] == found[1]


# --- steering ---------------------------------------------------------------------------


def head_on():
    ends = [(-2.0, 0.0), (2.0, 0.1)]
    return Course(
        pose=[[*ends[0], 0.0], [*ends[1], np.pi]],
        paths=[line(*ends, spacing=0.05), line(*ends[::-1], spacing=0.05)],
    )


@pytest.mark.parametrize("name", ["cluster_cbf", "decentralised_cbf"])
def test_asking_for_the_scene_changes_no_command(name):
    poses = []
    for asks in (True, False):
        course, controller = head_on(), registry.build("controller", Choice(name))
        for _ in range(60):
            if asks:
                controller.scene(course.view())
            course.step(controller)
        poses.append(course.pose.tobytes())
    assert poses[0] == poses[1]


def test_joint_program_couples_robots_that_would_be_solved_apart():
    course = head_on()
    controller = registry.build("controller", Choice("cluster_cbf"))
    view = course.view()
    program = controller.steering.program(view, controller.scene(view))
    assert program.rows.component.tolist() == [0, 1]
    assert program.as_one().rows.component.tolist() == [0, 0]
    apart = controller.steering.solve(program, always=True)
    joint = controller.steering.solve(program.as_one(), always=True)
    assert (apart.solved, joint.solved) == (2, 1)
    np.testing.assert_allclose(apart.inputs, joint.inputs, atol=1e-3)


@pytest.mark.parametrize("dynamics", ["unicycle", "holonomic"])
@pytest.mark.parametrize("name", ["cluster_cbf", "decentralised_cbf"])
@pytest.mark.parametrize("beside", [0.0, 0.3])
def test_nobody_pushes_away_a_robot_that_loads(name, dynamics, beside):
    course = Course(
        pose=[[-2.0, 0.0, 0.0], [0.0, -beside, 0.4]],
        paths=[line((-2.0, 0.0), (2.0, 0.0)), np.zeros((0, 2))],
        active=[True, True],
        walls=box(-4.0, -0.7, 4.0, 0.7),
        holonomic=dynamics == "holonomic",
    )
    controller = registry.build("controller", Choice(name, {"dynamics": dynamics}))
    course.run(controller, 10.0)
    np.testing.assert_allclose(course.pose[1, :2], [0.0, -beside], atol=1e-3)
    assert course.narrowest_robot > 0.5


# --- programs ---------------------------------------------------------------------------


def random_rows(rng, n, m=4):
    """A coupled program of ``n`` robots with ``m`` own rows each, some of them conflicting."""
    own, bound = np.zeros((n, 48, 2)), np.zeros((n, 48))
    for i in range(n):
        for k in range(m):
            angle, v = rng.uniform(0, 2 * np.pi), rng.uniform(0.05, 1)
            own[i, k] = [np.cos(angle), v * np.sin(angle)]
            most = abs(own[i, k, 0]) + 2 * abs(own[i, k, 1])
            bound[i, k] = min(rng.uniform(-1.0, 0.8), 0.98 * most)
    pair = np.array([(i, j) for i in range(n) for j in range(i + 1, n)], dtype=np.int64)
    return Rows(
        own=own,
        own_bound=bound,
        own_coupling=rng.choice([0.25, 1.0], (n, 48)),
        own_count=np.full(n, m),
        pair=pair.reshape(-1, 2),
        pair_row=rng.uniform(-1, 1, (len(pair), 4)),
        pair_bound=rng.uniform(-1, 0.5, len(pair)),
        pair_count=np.array([len(pair)]),
        component=np.zeros(n, dtype=np.int64),
    )


def demand(reference):
    n = len(reference)
    limit = np.tile([1.0, 2.0], (n, 1))
    return qp.Demand(reference, -limit, limit, np.ones(n))


def solve(rows, reference, **options):
    nowhere = np.zeros_like(reference)
    return qp.solve_fleet(rows, demand(reference), lambda: nowhere, slack_weight=50.0, **options)


def worst_break(rows, answer):
    """Largest amount by which an answer breaks a row of :func:`random_rows` [m/s^2]."""
    found = [0.0]
    for i, u in enumerate(answer.inputs):
        m = rows.own_count[i]
        value = rows.own[i, :m] @ u + rows.own_coupling[i, :m] * answer.slack[i]
        found += list(rows.own_bound[i, :m] - value)
    for (i, j), row, bound in zip(rows.pair, rows.pair_row, rows.pair_bound, strict=True):
        value = row[:2] @ answer.inputs[i] + row[2:] @ answer.inputs[j] + answer.slack[i]
        found.append(bound - value)
    return max(found)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_daqp_and_osqp_agree(n):
    rng = np.random.default_rng(n)
    for _ in range(40):
        rows, reference = random_rows(rng, n), rng.uniform(-1, 1, (n, 2)) * [1, 2]
        first, second = solve(rows, reference), solve(rows, reference, solver="osqp")
        assert first.usable.all()
        np.testing.assert_allclose(first.inputs, second.inputs, atol=5e-3)
        np.testing.assert_allclose(first.slack, second.slack, atol=2e-3)


def test_answer_is_that_of_a_general_optimiser():
    rng = np.random.default_rng(7)
    for _ in range(5):
        rows, reference = random_rows(rng, 2), rng.uniform(-1, 1, (2, 2)) * [1, 2]

        def broken(z, rows=rows):
            u = z[:-1].reshape(2, 2)
            own = [rows.own[i, :4] @ u[i] + rows.own_coupling[i, :4] * z[-1] for i in range(2)]
            pair = rows.pair_row @ z[:-1] + z[-1]
            bounds = [*rows.own_bound[:, :4], rows.pair_bound]
            return np.concatenate([*own, pair]) - np.concatenate(bounds)

        best = minimize(
            lambda z, r=reference: 0.5 * np.sum((z[:-1] - r.ravel()) ** 2) + 25.0 * z[-1] ** 2,
            np.append(reference, 3.0),
            bounds=[*[(-1.0, 1.0), (-2.0, 2.0)] * 2, (0, None)],
            constraints={"type": "ineq", "fun": broken},
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-12},
        )
        np.testing.assert_allclose(solve(rows, reference).inputs.ravel(), best.x[:-1], atol=2e-3)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_program_that_daqp_does_not_solve_is_solved_by_osqp(n, monkeypatch):
    rng = np.random.default_rng(n)
    rows, reference = random_rows(rng, n), rng.uniform(-1, 1, (n, 2)) * [1, 2]

    def stalled(program):
        return Solution(np.full(2 * n + 1, np.nan), solved=False)

    monkeypatch.setattr(qp, "solve_by_daqp", stalled)
    answer, other = solve(rows, reference), solve(rows, reference, solver="osqp")
    assert answer.usable.all()
    np.testing.assert_array_equal(answer.inputs, other.inputs)


def test_robots_brake_where_no_solver_answers(monkeypatch):
    rows, reference = random_rows(np.random.default_rng(0), 2), np.ones((2, 2))

    def failed(program):
        return Solution(np.full(5, np.nan), solved=False)

    monkeypatch.setattr(qp, "solve_by_osqp", failed)
    monkeypatch.setattr(qp, "solve_by_daqp", failed)
    answer = solve(rows, reference, always=True)
    assert not answer.usable.any()
    np.testing.assert_array_equal(answer.inputs, np.zeros((2, 2)))
    np.testing.assert_array_equal(answer.slack, np.zeros(2))


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
@settings(max_examples=60, deadline=None)
def test_answer_obeys_rows_and_hard_limits(seed, n):
    rng = np.random.default_rng(seed)
    rows, reference = random_rows(rng, n), rng.uniform(-1, 1, (n, 2)) * [1, 2]
    answer = solve(rows, reference)
    assert answer.usable.all()
    assert (np.abs(answer.inputs) <= [1.0, 2.0]).all()
    assert worst_break(rows, answer) <= 5e-3


def test_answer_does_not_depend_on_what_was_solved_before():
    rng = np.random.default_rng(3)
    rows, reference = random_rows(rng, 2), rng.uniform(-1, 1, (2, 2))
    before = solve(rows, reference)
    for _ in range(5):
        solve(random_rows(rng, 2), rng.uniform(-1, 1, (2, 2)))
    after = solve(rows, reference)
    assert before.inputs.tobytes() == after.inputs.tobytes()
    assert before.slack.tobytes() == after.slack.tobytes()


def test_reference_that_obeys_all_rows_is_the_answer_without_a_solver():
    rows = random_rows(np.random.default_rng(0), 2)
    rows.own_bound[:] = -10.0
    rows.pair_bound[:] = -10.0
    reference = np.array([[0.3, 0.1], [-0.2, 0.5]])
    answer = solve(rows, reference)
    assert answer.solved == 0
    np.testing.assert_array_equal(answer.inputs, reference)
    np.testing.assert_allclose(solve(rows, reference, always=True).inputs, reference, atol=1e-4)


def test_conflicting_rows_cost_slack_and_obstacles_give_way_least():
    rows = random_rows(np.random.default_rng(0), 1, m=2)
    rows.own[0, :2] = [[1.0, 0.0], [-1.0, 0.0]]
    rows.own_bound[0, :2] = 0.5
    rows.own_coupling[0, :2] = [0.25, 1.0]
    answer = solve(rows, np.zeros((1, 2)))
    assert answer.slack[0] == pytest.approx(0.8, abs=0.02)
    assert answer.inputs[0, 0] == pytest.approx(0.3, abs=0.02)
