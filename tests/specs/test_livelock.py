"""What drives in vain for good, and what only takes its time."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
from frames import DT, Robot, Script, judge, offer

from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import CommsOutage
from mrta_falsify.specs.liveness import NoLivelock

LOOK_AHEAD = 45.0
GOAL = (6.0, 0.0)


def no_livelock() -> NoLivelock:
    return NoLivelock(NoLivelock.Options(look_ahead=LOOK_AHEAD))


def circles(until: float, then):
    """A circle behind (-5, 0) at 0.75 m/s until a time; after it, ``then`` of the time since."""

    def at(time: float) -> tuple[float, float, float]:
        turn = min(time, until)
        x, y = -5.0 - 0.75 * (1.0 - np.cos(turn)), 0.75 * np.sin(turn)
        dx = then(max(time - until, 0.0))
        return float(x + dx), float(y), 0.0

    return at


def circling_until(until: float, then=lambda since: 0.0, **more) -> Script:
    return Script(robots=[Robot(circles(until, then), goal=GOAL)], **more)


def foretold(script: Script, seconds: float) -> tuple[Verdict, list[float]]:
    """Verdict after ``seconds``, forecasts showing the rest of the script; when they were asked."""
    script.seconds = seconds + 2.0 * LOOK_AHEAD
    world, judged = script.world(), no_livelock()
    frames = list(script.frames(world))
    asked, now = [], [0]

    def forecast(watch, *, without=(), nudge=0):
        if not nudge:
            asked.append(now[0] * DT)
        seen = copy.deepcopy(watch)  # a forecast runs in a copy of the process
        for frame in frames[now[0] + 1 :]:
            if seen.update(frame):
                break
        return seen.answer()

    judged.start(world, DT)
    offer(judged, world, forecast)
    for frame in frames[: round(seconds / DT) + 1]:
        now[0] = frame.sensed.tick
        judged.update(frame)
    return judged.verdict(), asked


# --- with forecasts --------------------------------------------------------------------------


def test_a_robot_that_circles_for_good_is_in_a_livelock():
    verdict, asked = foretold(circling_until(1e3), 64.0)
    assert verdict.who == ("robot1",)
    assert verdict.violated_at == pytest.approx(61.0)
    assert verdict.evidence["confirmed"]
    assert verdict.evidence["since"] == 0.5
    assert verdict.robustness == pytest.approx(60.5 - 64.0)
    assert set(asked) == {61.0}  # copies with small differences may be asked, too


def test_a_robot_that_is_held_up_for_longer_than_patience_and_goes_on_is_in_none():
    verdict, asked = foretold(circling_until(62.0, lambda since: 0.5 * since), 80.0)
    assert asked == [pytest.approx(61.0)]
    assert verdict.outcome == "holds"
    assert 0.0 < verdict.robustness < 5.0


def test_a_detour_that_takes_longer_than_patience_is_no_livelock():
    # From (-2, 0) to (2, 0) around a wall; for 85 s the straight distance is no shorter.
    corners = np.array([(-2.0, 0.0), (-2.0, 10.5), (2.0, 10.5), (2.0, 0.0)])
    lengths = np.hypot(*np.diff(corners, axis=0).T).cumsum()

    def at(time):
        x, y = (np.interp(0.25 * time, [0.0, *lengths], corners[:, k]) for k in range(2))
        return float(x), float(y), 0.0

    script = Script(
        robots=[Robot(at, goal=(2.0, 0.0))],
        walls=[rectangle(0.2, 21.0, (0.0, -1.5))],
        bounds=(-4.0, -12.0, 4.0, 12.0),
    )
    verdict, asked = foretold(script, 100.0)
    assert asked == [pytest.approx(61.0)]
    assert verdict.outcome == "holds"


def test_who_comes_to_a_standstill_drives_in_vain_no_longer():
    verdict, asked = foretold(circling_until(62.0), 80.0)
    assert len(asked) == 1
    assert verdict.outcome == "holds"


def test_robots_whose_continuation_tells_nothing_are_not_claimed():
    script = circling_until(1e3, seconds=70.0)
    world, judged = script.world(), no_livelock()
    judged.start(world, DT)
    offer(judged, world, lambda watch, *, without=(), nudge=0: None)
    for frame in script.frames(world):
        judged.update(frame)
    assert judged.verdict().outcome == "holds"


# --- without: suspected at most ----------------------------------------------------------------


def is_suspected(script: Script) -> bool:
    verdict = judge(no_livelock(), script)
    assert not verdict.violated
    return verdict.outcome == "not_judged" and "livelock is suspected" in verdict.not_judged


def test_circling_that_cannot_be_copied_is_suspected_and_no_failure():
    verdict = judge(no_livelock(), circling_until(1e3, seconds=70.0))
    assert verdict.outcome == "not_judged"
    assert verdict.who == ("robot1",)
    assert not verdict.evidence["confirmed"]
    assert verdict.evidence["travelled"] > 5.0


def test_alternating_goals_are_suspected_too():
    ahead, behind = GOAL, (-16.0, 0.0)
    script = circling_until(1e3, seconds=70.0)
    there_and_back = Robot(
        script.robots[0].at, goal=lambda time: ahead if int(time / 3) % 2 else behind
    )
    assert is_suspected(dataclasses.replace(script, robots=[there_and_back]))


def test_a_suspicion_is_dropped_once_the_robot_goes_on():
    script = circling_until(65.0, lambda since: 0.5 * since, seconds=64.0)
    assert is_suspected(script)
    script.seconds = 80.0
    assert judge(no_livelock(), script).outcome == "holds"


def test_an_outage_that_ends_is_waited_for():
    outage = CommsOutage(name="out", robots=(), start=0.0, end=65.0)
    script = circling_until(1e3, seconds=64.0, events=[outage])
    assert not is_suspected(script)
    script.seconds = 70.0
    assert is_suspected(script)


def test_robustness_falls_while_a_robot_drives_in_vain_but_not_to_zero():
    margins = [
        judge(no_livelock(), circling_until(1e3, seconds=s)).robustness for s in (20.0, 40.0, 58.0)
    ]
    assert margins[0] > margins[1] > margins[2] > 0.0
