"""Do robots go the same way in another simulator, by the same commands?

    pip install ir-sim
    python -m experiments.validity.motion WORLDS.json -o ROWS.json [--count 20] [--until 60]
    python -m experiments.validity.motion --table ROWS.json

Some of the listed worlds of :mod:`experiments.validity.engines` run on each engine. ir-sim
(MIT) then gets the robots at their starts, with their footprints and limits, and the commands that
were recorded, tick by tick; its drives and its test of what touches are its own. Nothing steers
back, so what differs adds up. ir-sim lets bodies pass through each other, and tells that they
touch. Worlds with people, blockages, furniture on wheels or wheels that slip are left out.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import json
import sys
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from shapely.geometry import MultiPoint, Polygon

from experiments.validity.engines import Row, program_named
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.specs.contacts import closest
from mrta_falsify.specs.library import build_specifications
from simulator_interface.engines.bodies import gather_fleet
from simulator_interface.episode import Episode

CASES = (("kinematic", 2), ("kinematic", 4), ("bullet", 4), ("mujoco", 4))
#: engine, and steps of ir-sim in a tick of 50 ms; the first of each engine are its own
NEAR = 2.0  # m; solids farther from all ways are left out
NOW = 1e-9  # s; times are products of floats
LEAST_WAY = 1.0  # m; of robots whose deviation is told as a share of it
MOTION_SPECS = ("exclusive_use", "no_robot_robot_contact", "no_robot_static_contact")


class Driven(NamedTuple):
    """What robots did in ir-sim, at the ends of ticks."""

    pose: Array  #: (K, N, 3)
    contact: BoolArray  #: (K, N, 3) touched a robot, human, static during the tick


def recorded(world: World, engine: str, until: float) -> list[Frame]:
    """Run a world under the default stack."""
    episode = Episode(world, StackConfig(engine=Choice(engine)))
    running, seen = episode.frames(), []
    try:
        for frame in running:
            seen.append(frame)
            if episode.all_done or frame.sensed.time >= min(until, world.horizon):
                break
    finally:
        running.close()
    return seen


# --- in ir-sim --------------------------------------------------------------------------------


def scene_of(world: World, dt: float, step: float, ways: MultiPoint) -> dict[str, Any]:
    """Export a world as ir-sim's scene, with the solids near where robots went."""
    fleet = gather_fleet(world.robots)
    low, high = world.bounds[:2], world.bounds[2:]
    robots = [
        {
            "kinematics": {"name": "diff"},
            "shape": _outline(fleet.outline[i, : fleet.corners[i]]),
            "state": robot.pose.tolist(),
            "goal": [0.0, 0.0, 0.0],
            "vel_min": [-fleet.max_speed[i].item(), -fleet.max_turn_rate[i].item()],
            "vel_max": [fleet.max_speed[i].item(), fleet.max_turn_rate[i].item()],
            "acce": [fleet.max_acceleration[i].item(), fleet.max_turn_acceleration[i].item()],
        }
        for i, robot in enumerate(world.robots)
    ]
    solids = [one for one in world.solid_polygons() if ways.distance(Polygon(one)) < NEAR]
    return {
        "world": {
            "width": float(high[0] - low[0]),
            "height": float(high[1] - low[1]),
            "offset": low.tolist(),
            "step_time": step,
            "sample_time": dt,
            "collision_mode": "unobstructed",
        },
        "robot": robots,
        "obstacle": [{"shape": _outline(one), "state": [0.0, 0.0, 0.0]} for one in solids],
    }


def _outline(polygon: Array) -> dict[str, Any]:
    return {"name": "polygon", "vertices": np.asarray(polygon).tolist()}


def driven(world: World, frames: Sequence[Frame], steps: int) -> Driven:
    """Drive ir-sim's robots by the commands of a run, with so many steps in a tick."""
    irsim = importlib.import_module("irsim")
    dt = frames[1].sensed.time - frames[0].sensed.time
    ways = MultiPoint(np.concatenate([frame.sensed.pose[:, :2] for frame in frames[::10]]))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(yaml.safe_dump(scene_of(world, dt, dt / steps, ways)))
        env = irsim.make(str(path), display=False, disable_all_plot=True, log_level="ERROR")
    robots = env.robot_list
    pose = np.zeros((len(frames), len(robots), 3))
    contact = np.zeros((len(frames), len(robots), 3), dtype=np.bool_)
    pose[0] = [robot.state[:3, 0] for robot in robots]
    sent = np.array([frame.command.twist[:, [0, 2]] for frame in frames])
    for tick in range(len(frames) - 1):
        for step in range(tick * steps, (tick + 1) * steps):
            env.step(_due(world, sent, step, dt / steps, steps), list(range(len(robots))))
            for i, robot in enumerate(robots):
                for other in robot.collision_obj:
                    contact[tick + 1, i, 0 if other.role == "robot" else 2] = True
        pose[tick + 1] = [robot.state[:3, 0] for robot in robots]
    env.end(0)
    return Driven(pose, contact)


def _due(world: World, sent: Array, step: int, length: float, steps: int) -> list[Array]:
    """Find the command ``(2, 1)`` of each robot in a step of ``length`` [s]."""
    due = []
    for i, robot in enumerate(world.robots):
        at = (step - round(robot.command_latency / length)) // steps
        joined = step * length >= robot.joins_at - NOW
        due.append(sent[at, i, :, None] if at >= 0 and joined else np.zeros((2, 1)))
    return due


# --- beside each other ------------------------------------------------------------------------


def violated(world: World, frames: Sequence[Frame]) -> list[str]:
    """Judge frames by the specifications that rest on motion alone."""
    judges = build_specifications(MOTION_SPECS)
    dt = frames[1].sensed.time - frames[0].sensed.time
    for one in judges:
        one.start(world, dt)
    for frame in frames:
        for one in judges:
            one.update(frame)
    closest.cache_clear()
    return sorted(one.verdict().spec for one in judges if one.verdict().violated)


def moved(frames: Sequence[Frame], there: Driven) -> list[Frame]:
    """Put what was driven in place of what the engine measured."""
    dt = frames[1].sensed.time - frames[0].sensed.time
    before = np.concatenate([there.pose[:1], there.pose[:-1]])
    step = (there.pose - before) / dt
    ahead = np.cos(before[..., 2]) * step[..., 0] + np.sin(before[..., 2]) * step[..., 1]
    turn = (step[..., 2] * dt + np.pi) % (2.0 * np.pi) - np.pi
    velocity = np.stack([ahead, np.zeros_like(ahead), turn / dt], axis=-1)
    gap = np.where(there.contact, 0.0, np.inf)
    return [
        dataclasses.replace(
            frame,
            sensed=dataclasses.replace(
                frame.sensed,
                pose=there.pose[k],
                velocity=velocity[k],
                contact=there.contact[k],
                gap_robot=gap[k, :, 0],
                gap_human=gap[k, :, 1],
                gap_static=gap[k, :, 2],
            ),
        )
        for k, frame in enumerate(frames)
    ]


def compared(of: Row, world: World, frames: Sequence[Frame], case: tuple[str, int]) -> Row:
    """Drive ir-sim by the commands of a run, and compare."""
    there = driven(world, frames, case[1])
    pose = np.array([frame.sensed.pose for frame in frames])
    off = np.hypot(*(there.pose - pose)[..., :2].transpose(2, 0, 1))
    turned = (there.pose[-1, :, 2] - pose[-1, :, 2] + np.pi) % (2.0 * np.pi) - np.pi
    way = np.hypot(*np.diff(pose[..., :2], axis=0).transpose(2, 0, 1)).sum(axis=0)
    contact = np.array([frame.sensed.contact for frame in frames]).any(axis=0)
    return {
        "scenario": of["scenario"],
        "seed": of["seed"],
        "case": list(case),
        "time": frames[-1].sensed.time,
        "way": way.tolist(),
        "off_at_end": off[-1].tolist(),
        "off_at_worst": off.max(axis=0).tolist(),
        "turned_at_end": np.abs(turned).tolist(),
        "touched": contact.tolist(),
        "touched_there": there.contact.any(axis=0).tolist(),
        "violated": violated(world, frames),
        "violated_there": violated(world, moved(frames, there)),
    }


def is_known_there(world: World) -> bool:
    """Whether ir-sim knows all that a world has."""
    slips = any(robot.wheel_slip for robot in world.robots)
    holonomic = gather_fleet(world.robots).holonomic.any()
    changes = any(isinstance(event, Blockage) for event in world.events)
    return not (slips or holonomic or changes or world.humans or world.movable_furniture())


def main() -> None:
    """Command line."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("worlds", type=Path, nargs="?")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--count", type=int, default=20, help="worlds, spread over the list")
    parser.add_argument("--until", type=float, default=60.0, help="s of a run at most")
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    if args.table:
        print("\n".join(table(json.loads(args.table.read_text(encoding="utf-8")))))
        return
    rows: list[Row] = []
    for of, world in _spread(json.loads(args.worlds.read_text(encoding="utf-8")), args.count):
        for case in CASES:
            rows.append(compared(of, world, recorded(world, case[0], args.until), case))
            args.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
            print(of["scenario"], case, max(rows[-1]["off_at_end"]), flush=True)


def _spread(listed: Sequence[Row], count: int) -> list[tuple[Row, World]]:
    """Take so many of the worlds that ir-sim knows all of, spread evenly over the list."""
    known = []
    for of in listed:
        world = program_named(of["scenario"]).sample(of["seed"])
        if world.digest() != of["world"]:
            print(f"{of['scenario']} {of['seed']} is another world by now", file=sys.stderr)
        elif is_known_there(world):
            known.append((of, world))
    places = np.linspace(0, len(known) - 1, min(count, len(known))).round().astype(int)
    return [known[k] for k in places]


def table(rows: Sequence[Row]) -> list[str]:
    """Write how far robots end from where they did, and who touched what."""
    lines = [
        "| Recorded on | Steps [ms] | Robots | Way [m] | Off at the end [m]: median, 95 % "
        "| Of the way | Turned off [rad] | Touch: both, there only, ir-sim only "
        "| Worlds judged alike |",
        "|---" * 9 + "|",
    ]
    for engine, steps in CASES:
        own = [row for row in rows if row["case"] == [engine, steps]]
        way, off, turned = (
            np.concatenate([row[name] for row in own])
            for name in ("way", "off_at_end", "turned_at_end")
        )
        here, there = (
            np.concatenate([np.array(row[name]).any(axis=1) for row in own])
            for name in ("touched", "touched_there")
        )
        alike = sum(row["violated"] == row["violated_there"] for row in own)
        drove = way > LEAST_WAY
        lines.append(
            f"| {engine} | {50 / steps:g} | {len(way)} | {np.median(way):.0f} "
            f"| {np.median(off):.3f}, {np.quantile(off, 0.95):.3f} "
            f"| {np.median(off[drove] / way[drove]):.2%} "
            f"| {np.median(turned):.3f}, {np.quantile(turned, 0.95):.3f} "
            f"| {(here & there).sum()}, {(here & ~there).sum()}, {(~here & there).sum()} "
            f"| {alike} of {len(own)} |"
        )
    return lines


if __name__ == "__main__":
    main()
