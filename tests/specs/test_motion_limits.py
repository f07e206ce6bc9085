"""Speed, acceleration and turn rate from motion alone."""

import dataclasses

import numpy as np
import pytest
from frames import DT, Robot, Script, drive, judge

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.world import RobotSpec, World
from mrta_falsify.specs.motion_limits import KinematicLimits


def limits(**options) -> KinematicLimits:
    return registry.build("specification", Choice("kinematic_limits", options))


def gently(speed: float, rate: float = 0.9):
    """Along x from rest up to ``speed`` [m/s] at ``rate`` [m/s^2], then at that speed."""

    def at(time: float) -> tuple[float, float, float]:
        rising = min(time, speed / rate)
        return 0.5 * rate * rising**2 + speed * (time - rising), 0.0, 0.0

    return at


def test_a_robot_within_its_limits_keeps_them():
    verdict = judge(limits(), Script(robots=[Robot(gently(1.5))], seconds=6.0))
    assert verdict.outcome == "holds"
    assert verdict.robustness == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("track", "limit", "robustness"),
    [
        (gently(2.25), "speed", 0.1 - 0.5),
        (gently(1.2, rate=2.0), "acceleration", 0.1 - 1.0),
        (lambda t: (0.0, 0.0, 3.0 * t), "turn_rate", 0.1 - 0.5),
        (lambda t: (-gently(1.2, rate=2.0)(t)[0], 0.0, np.pi), "acceleration", 0.1 - 1.0),
    ],
)
def test_each_limit_is_judged_by_its_share(track, limit, robustness):
    verdict = judge(limits(), Script(robots=[Robot((0, 5)), Robot(track)], seconds=4.0))
    assert verdict.who == ("robot2",)
    assert (verdict.evidence["robot"], verdict.evidence["limit"]) == ("robot2", limit)
    assert verdict.robustness == pytest.approx(robustness, abs=0.03)


def test_a_robot_that_jumps_is_too_fast():
    script = Script(robots=[Robot(lambda t: (2.0 * (t > 3.0), 0.0, 0.0))], seconds=5.0)
    verdict = judge(limits(), script)
    assert verdict.violated
    assert verdict.violated_at == pytest.approx(3.0, abs=0.1)


def test_a_robot_that_is_shoved_is_not_to_blame():
    shoved = Script(robots=[Robot(gently(3.0, rate=3.0))], seconds=2.0)
    world, specification = shoved.world(), limits()
    specification.start(world, DT)
    touched = np.array([[False, True, False]])
    for frame in shoved.frames(world):
        sensed = dataclasses.replace(frame.sensed, contact=touched)
        specification.update(dataclasses.replace(frame, sensed=sensed))
    assert specification.verdict().outcome == "holds"


def test_wheels_that_slip_excuse_turning_and_acceleration_but_no_speed():
    def on_slippery_floor(track):
        script = Script(robots=[Robot(track)], seconds=4.0)
        world = script.world()
        robots = (dataclasses.replace(world.robots[0], wheel_slip=0.1),)
        world, specification = dataclasses.replace(world, robots=robots), limits()
        specification.start(world, DT)
        for frame in script.frames(world):
            specification.update(frame)
        return specification.verdict()

    assert not on_slippery_floor(gently(1.2, rate=2.0)).violated
    assert on_slippery_floor(drive((0, 0), (9, 0), 2.0)).violated


@pytest.mark.parametrize("engine", ["kinematic", "bullet"])
@pytest.mark.parametrize("model", ["waffle", "holonomic"])
def test_no_drive_of_ours_exceeds_its_limits_whatever_it_is_commanded(engine, model):
    random = np.random.default_rng(4)
    robot = RobotSpec(name="robot1", model=model, pose=np.zeros(3), command_latency=0.1)
    world = World(name="open", bounds=np.array([-99.0, -99.0, 99.0, 99.0]), robots=(robot,))
    driven, specification = registry.build("engine", Choice(engine)), limits()
    specification.start(world, DT)
    nobody, twist = np.zeros((0, 2)), np.zeros((1, 3))
    try:
        sensed = driven.start(world, DT, nobody)
        for tick in range(400):
            if tick % 15 == 0:
                sideways = 3.0 if model == "holonomic" else 0.0
                twist = random.uniform(-1.0, 1.0, (1, 3)) * [3.0, sideways, 4.0]
            specification.update(_Seen(sensed))
            sensed = driven.step(Command(twist=twist), nobody)
    finally:
        driven.close()
    assert specification.verdict().outcome == "holds"


@dataclasses.dataclass
class _Seen:
    """As much of a frame as the specification looks at."""

    sensed: object
