"""How the Bullet engine was tuned: speed and tracking error of each setting.

    python experiments/engine/tune.py [--seconds 10] [--markdown]

Speed: `aws_hospital_day` (6 robots, 8 people, 345 solids), all robots driving circles in
their rooms, 20 Hz, rays and gaps included, in CPU time of this process. Tracking: one robot
over a course of straights, turns, arcs and stops; worst error of the steady speed and turn
rate in percent of the command, and creep of a standing robot without the brake.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pybullet

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.world import Furniture, RobotSpec, Wall, World
from scenic_worlds.layouts import load_world
from simulator_interface.engines import gaps
from simulator_interface.engines.bullet import BulletEngine
from simulator_interface.engines.bullet_client import ROBOT, SOLID
from simulator_interface.engines.kinematic import KinematicEngine
from simulator_interface.engines.robot_models import ROBOTS

DT = 0.05
CIRCLE = (0.3, 0.0, 0.9)
#: seconds, forward [m/s], turn rate [rad/s]
COURSE = (
    (2.5, 1.0, 0.0),
    (1.5, 0.0, 0.0),
    (2.0, 0.0, 1.5),
    (2.0, 0.0, -1.5),
    (2.5, 0.5, 0.8),
    (2.5, 0.5, -0.8),
    (2.5, 0.1, 0.0),
    (2.5, 1.5, 0.0),
    (2.0, 0.0, 0.0),
    (2.5, -0.4, 0.0),
    (1.5, 0.0, 0.0),
)

LIGHT = 'ixx="5e-05" ixy="0" ixz="0" iyy="5e-05" iyz="0" izz="5.5e-05"'
GEARED = 'ixx="5e-04" ixy="0" ixz="0" iyy="5e-04" iyz="0" izz="5.5e-04"'
SPHERE, CYLINDER = '<sphere radius="0.033"/>', '<cylinder radius="0.033" length="0.018"/>'


class ManyBodies(BulletEngine):
    """Each wall and piece of furniture is a body of its own."""

    def _build_solids(self, world: World) -> None:
        solids: list[Wall | Furniture] = [*world.walls, *world.furniture]
        for solid in solids:
            body = self._add_solid([solid.polygon], [solid.height])
            self.client.column[body] = gaps.STATIC

    def _add_solid(self, polygons: Sequence[Array], heights: Sequence[float]) -> int:
        return self.client.add_solid(polygons, heights)


class ManyHulls(ManyBodies):
    """The same, as convex hulls."""

    def _add_solid(self, polygons: Sequence[Array], heights: Sequence[float]) -> int:
        call = self.client.call
        corners = [(x, y, z) for x, y in polygons[0] for z in (0.0, heights[0])]
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=corners, **call)
        body: int = pybullet.createMultiBody(0.0, shape, **call)
        self.client.collide(body, -1, SOLID, ROBOT)
        return body


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One row of the table."""

    label: str
    engine: Any = BulletEngine
    options: dict[str, object] = field(default_factory=dict)
    wheel: str = SPHERE
    inertia: str = GEARED


OLD = {"step_size": 1 / 240, "solver_iterations": 50, "contact_margin": 0.02}
SETTINGS = (
    Setting(label="untuned: 1/240 s, 50 iterations, cylinder wheels, a hull per solid",
            engine=ManyHulls, options=OLD, wheel=CYLINDER, inertia=LIGHT),
    Setting(label="+ one mesh for all solids", options=OLD, wheel=CYLINDER, inertia=LIGHT),
    Setting(label="+ sphere wheels", options=OLD, inertia=LIGHT),
    Setting(label="+ contact margin 1 mm", options={**OLD, "contact_margin": 0.001}, inertia=LIGHT),
    Setting(label="+ step 1/80 s", options={"solver_iterations": 50}, inertia=LIGHT),
    Setting(label="+ 8 iterations", inertia=LIGHT),
    Setting(label="+ geared wheel inertia = DEFAULT"),
    Setting(label="default, cylinder wheels", wheel=CYLINDER),
    Setting(label="default, a mesh per solid", engine=ManyBodies),
    Setting(label="default, contact margin 5 mm", options={"contact_margin": 0.005}),
    Setting(label="default, step 1/240 s", options={"step_size": 1 / 240}),
    Setting(label="default, step 1/100 s", options={"step_size": 0.01}),
    Setting(label="default, step 1/60 s", options={"step_size": 1 / 60}),
    Setting(label="default, 20 iterations", options={"solver_iterations": 20}),
    Setting(label="default, 4 iterations", options={"solver_iterations": 4}),
    Setting(label="default, 2 iterations", options={"solver_iterations": 2}),
    Setting(label="default, Bullet's rays", options={"rays": "bullet"}),
    Setting(label="kinematic engine", engine=KinematicEngine),
)  # fmt: skip


def write_model(folder: Path, setting: Setting) -> str:
    """Model file of the Waffle with the setting's wheels."""
    text = (ROBOTS / "waffle.urdf").read_text()
    assert SPHERE in text
    assert GEARED in text
    text = text.replace(SPHERE, setting.wheel).replace(GEARED, setting.inertia)
    (folder / "waffle.urdf").write_text(text)
    (folder / "waffle_hull.obj").write_text((ROBOTS / "waffle_hull.obj").read_text())
    path = folder / "waffle.yaml"
    path.write_text(
        "urdf: waffle.urdf\njoints: [wheel_left_joint, wheel_right_joint]\nwheels_touch: floor\n"
    )
    return str(path)


def measure_speed(setting: Setting, model: str, seconds: float) -> tuple[float, float, float]:
    """Start [ms], tick [ms] and real-time factor, CPU time, the better of two runs."""
    world = load_world("aws_hospital_day")
    robots = tuple(dataclasses.replace(robot, model=model) for robot in world.robots)
    world = dataclasses.replace(world, robots=robots)
    places = np.array([human.route[0] for human in world.humans])
    command = Command(twist=np.tile(CIRCLE, (len(robots), 1)))
    starts, ticks = [], []
    for _ in range(2):
        engine = setting.engine(setting.engine.Options(**setting.options))
        began = time.process_time()
        engine.start(world, DT, places)
        starts.append(time.process_time() - began)
        count = round(seconds / DT)
        began = time.process_time()
        for k in range(count):
            walk = np.tile([0.5 * np.cos(k / 20), 0.5 * np.sin(k / 20)], (len(places), 1))
            engine.step(command, walk)
        ticks.append((time.process_time() - began) / count)
        engine.close()
    return 1e3 * min(starts), 1e3 * min(ticks), DT / min(ticks)


@dataclass(frozen=True)
class Tracking:
    """Errors over the course."""

    speed: float  #: worst steady error [%]
    turn: float  #: [%]
    lag: float  #: behind the set point while it changes [ms]
    creep: float  #: of a robot that stands for 20 s [mm]


def measure_tracking(setting: Setting, model: str) -> Tracking:
    """One robot over the course."""
    spec = RobotSpec(name="robot1", model=model, pose=frozen_array([0, 0, 0]))
    world = World(name="course", bounds=frozen_array([-30, -30, 30, 30]), robots=(spec,))
    engine = setting.engine(setting.engine.Options(**setting.options))
    nobody = np.zeros((0, 2))
    sensed = engine.start(world, DT, nobody)
    if isinstance(engine, BulletEngine):  # the brake would hide the creep
        engine._robots.update_brakes = lambda *_: None
    worst, lags = np.zeros(2), []
    for seconds, v, w in COURSE:
        command = Command(twist=np.array([[v, 0.0, w]]))
        steady = []
        for k in range(round(seconds / DT)):
            before = engine._actuation.motors.set_point[0, 0]
            sensed = engine.step(command, nobody)
            after = engine._actuation.motors.set_point[0, 0]
            if abs(after - before) > 0.99 * DT * spec.max_acceleration:
                lags.append((after - sensed.velocity[0, 0]) / ((after - before) / DT))
            if k * DT >= seconds - 0.5:
                steady.append(sensed.velocity[0, [0, 2]])
        error = np.abs(np.mean(steady, axis=0) - [v, w])
        for axis, target in enumerate((v, w)):
            if target:
                worst[axis] = max(worst[axis], 100.0 * error[axis] / abs(target))
    stood = sensed.pose[0]
    for _ in range(round(20.0 / DT)):
        sensed = engine.step(Command(twist=np.zeros((1, 3))), nobody)
    engine.close()
    creep = 1e3 * float(np.hypot(*(sensed.pose[0, :2] - stood[:2])))
    return Tracking(worst[0], worst[1], 1e3 * float(np.mean(lags)), creep)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=5.0, help="simulated, per setting")
    parser.add_argument("--markdown", action="store_true", help="as a Markdown table")
    options = parser.parse_args()
    heads = ("setting", "start ms", "tick ms", "x real time", "speed %", "turn %", "lag ms",
             "creep mm")  # fmt: skip
    if options.markdown:
        print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))
    else:
        print(f"{heads[0]:68}" + "".join(f"{head:>13}" for head in heads[1:]))
    with tempfile.TemporaryDirectory() as name:
        for number, setting in enumerate(SETTINGS):
            folder = Path(name) / str(number)  # Bullet keeps files it has read once
            folder.mkdir()
            model = write_model(folder, setting)
            if number == 0:
                measure_speed(SETTINGS[-1], model, 1.0)  # compile
            start, tick, factor = measure_speed(setting, model, options.seconds)
            track = measure_tracking(setting, model)
            cells = (f"{start:.0f}", f"{tick:.2f}", f"{factor:.0f}", f"{track.speed:.1f}",
                     f"{track.turn:.1f}", f"{track.lag:.0f}", f"{track.creep:.1f}")  # fmt: skip
            if options.markdown:
                print("| " + " | ".join((setting.label, *cells)) + " |", flush=True)
            else:
                print(f"{setting.label:68}" + "".join(f"{cell:>13}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
