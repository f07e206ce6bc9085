from __future__ import annotations

import base64
import dataclasses
import json
import zlib

import numpy as np
import pytest

from mrta_falsify.core.trace import EdgeSpan
from reports.packing import NOWHERE, kept_ticks, pack


def unpack(text):
    """What the page's script does, in Python."""
    raw = zlib.decompress(base64.b64decode(text))
    head, _, body = raw.partition(b"\n")
    data, at = json.loads(head), 0
    for name, kind, shape in data["arrays"]:
        count = int(np.prod(shape))
        array = np.frombuffer(body, dtype=f"<{kind}", count=count, offset=at).reshape(shape)
        at += array.nbytes
        data[name] = array
    assert at == len(body)
    for name in ("xy", "people", "goal", "pieces"):
        data[name] = np.cumsum(data[name], axis=0, dtype="<i2")
    return data


@pytest.fixture(scope="module")
def packed(stalled):
    world, judged = stalled
    text = pack(world, judged.outcome.trace, judged.verdicts)
    return world, judged.outcome.trace, unpack(text), len(text)


def test_positions_come_back_to_the_centimetre(packed):
    _, trace, data, _ = packed
    ticks = np.round(np.array(data["time"]) / trace.dt).astype(int)
    wanted = trace.columns["pose"][ticks]
    np.testing.assert_allclose(data["xy"] / 100.0, wanted[:, :, :2], atol=0.0051)
    turn = data["yaw"] / 256.0 * 2.0 * np.pi - wanted[:, :, 2]
    assert np.abs(np.angle(np.exp(1j * turn))).max() <= np.pi / 256.0 + 1e-9


def test_robots_without_a_goal_have_none(stalled):
    world, judged = stalled
    trace = judged.outcome.trace
    goal = trace.columns["goal"].copy()
    goal[100:300] = np.nan
    idle = dataclasses.replace(trace, columns={**trace.columns, "goal": goal})
    data = unpack(pack(world, idle, ()))
    ticks = np.round(np.array(data["time"]) / trace.dt).astype(int)
    none = np.isnan(goal[ticks][..., 0])
    np.testing.assert_array_equal((data["goal"] == NOWHERE).all(axis=-1), none)
    np.testing.assert_allclose(data["goal"][~none] / 100.0, goal[ticks][~none], atol=0.0051)


def test_the_last_tick_is_kept_and_violations_are_listed(packed):
    _, trace, data, _ = packed
    assert data["time"][-1] == pytest.approx(trace.duration)
    assert [row[1] for row in data["violations"]] == ["no_deadlock"]
    assert len(data["events"]) == len(trace.events)


def test_every_blocked_by_edge_is_there_with_its_times(packed):
    _, trace, data, _ = packed
    spans = [span for span in trace.edges if span.edge.cause != "task"]
    assert spans
    assert all(isinstance(span, EdgeSpan) for span in spans)
    assert [row[2:4] for row in data["edges"]] == [[s.edge.robot, s.edge.cause] for s in spans]


def test_a_minute_of_a_small_world_takes_a_few_kilobytes(packed):
    *_, size = packed
    assert size < 30_000


def test_a_long_run_is_kept_in_full_at_its_end_and_around_violations():
    dt, hours = 0.05, 8 * 3600.0
    count = round(hours / dt)
    ticks = kept_ticks(count, dt, [5000.0])
    times = ticks * dt
    assert (times[0], ticks[-1]) == (0.0, count - 1)
    for first, last in ((4960.5, 5009.5), (hours - 119.5, hours)):
        within = times[(times >= first) & (times <= last)]
        assert np.diff(within).max() <= 0.2 + 1e-9
    assert len(ticks) < 3000
    assert np.diff(times).max() < 20.0


def test_a_short_run_is_kept_at_one_rate_wherever_it_fails():
    np.testing.assert_array_equal(kept_ticks(1001, 0.05, [13.37]), np.arange(0, 1001, 4))
