"""MRTA-Sim's own nodes as a stack: not a line of them is changed.

Dispatcher with SMrTa, goal setters, room queues, planner wrapper and six CBF controllers run on the
stand-in for rclpy. The harness stands in for Gazebo, Nav2's planner, the node that casts rays into
the map, and the node that tells where people are. Clarabel takes the place of Gurobi.
"""

from __future__ import annotations

import functools
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import cvxpy
import jax
import numpy as np

from simulator_interface.clients.mrta_stack import serve
from simulator_interface.foreign.interfaces import parse_interface
from simulator_interface.foreign.ros_nodes import navigator
from simulator_interface.foreign.ros_nodes.node_stack import NodeGraph
from simulator_interface.foreign.ros_nodes.ros_messages import DEFINITIONS, message_class
from simulator_interface.foreign.ros_nodes.ros_programs import Launch

PACKAGE, MESSAGES = "social_navigation_py", "social_navigation_msgs"
CASE = "simulation/testcase_6agents_3_3.json"  # the file that the dispatcher reads
DATA = ("roadmap_and_queues.pkl", "travel_time_07_22_24_full.pkl")  # read by their nodes alone
ROOMS = 6  # that their nodes know
RAYS_EVERY = 0.1  # s between two messages of the node that casts rays
AT_REST = 0.1  # m/s along each axis, slow enough to load


class Checkout:
    """Where the parts of MRTA-Sim lie.

    Args:
        folder: holds checkouts of the stack and of SMrTa, at any depth.
    """

    def __init__(self, folder: Path) -> None:
        self.nodes = self._find(folder, f"{PACKAGE}/dispatcher.py").parent.parent
        self.allocator = self._find(folder, "MRTASolver/MRTASolver.py").parent.parent
        self.data = [self._find(folder, name) for name in DATA]
        self.messages = sorted(self._find(folder, "msg/QueueMsg.msg").parent.glob("*.msg"))

    @staticmethod
    def _find(folder: Path, name: str) -> Path:
        found = sorted(folder.rglob(name), key=lambda path: (len(path.parts), path))
        if not found:
            sys.exit(f"MRTA_SIM: there is no {name} in {folder}")
        return found[0]


class MrtaSim:
    """The nodes, asked a tick.

    Args:
        checkout: of their source.
        world: message of the door.
        harness: plans in place of Nav2.
    """

    def __init__(self, checkout: Checkout, world: dict[str, Any], harness: Any) -> None:
        self._robots = [f"robot{number + 1}" for number in range(len(world["robots"]))]
        self._people = int(world["params"].get("people", 2))
        self._ray_ticks = max(1, round(RAYS_EVERY / world["dt"]))
        self._tasks = _write_files(world, checkout, self._robots)
        os.environ["SMRTA"] = str(checkout.allocator)
        self._graph = NodeGraph(
            world,
            _launches(self._robots),
            folders=[str(checkout.nodes), str(checkout.allocator)],
            patches={
                f"{PACKAGE}.utils.cbf_multiagent_obstacle_controller": _share_compiled_functions
            },
        )
        cache = functools.lru_cache(maxsize=1)(harness.plan)
        navigator.BasicNavigator.planner = staticmethod(lambda *ends: cache(*map(tuple, ends)))
        self._twist = np.zeros((len(self._robots), 3))
        self._arrived = [0] * len(self._robots)
        self._service = [(t["pickup_time"], t["dropoff_time"]) for t in world["tasks"]]
        self._loading: list[list[dict[str, Any]]] = [[] for _ in self._robots]  # stops, in order
        self._rests_since = [np.inf] * len(self._robots)  # while it loads [s]
        self._paths: list[Any] = [None] * len(self._robots)
        self._open()

    def step(self, tick: dict[str, Any]) -> dict[str, Any]:
        """Answer a tick."""
        if tick["closed"]:
            self._dispatcher.task_set_index = len(self._dispatcher.tasks_stream)
        self._publish(tick)
        self._graph.advance(tick["time"])
        setters = self._graph.program("goal_setter").nodes
        events = [event for robot in range(len(setters)) for event in self._stops(robot, tick)]
        is_held = np.array([len(stops) > 0 for stops in self._loading])
        return {
            "twist": np.where(is_held[:, None], 0.0, self._twist),
            "goal": np.array([_goal(setter) for setter in setters]),
            "stops_left": [max(0, len(s.locs) - s.goal_idx) for s in setters],
            "events": events,
            "paths": self._changed_paths() if tick["tick"] % 5 == 0 else [],
        }

    @property
    def _dispatcher(self) -> Any:
        return self._graph.program("dispatcher").nodes[0]

    def _open(self) -> None:
        """Connect the harness's ends of their topics."""
        graph = self._graph

        def drive(robot: int, message: Any) -> None:
            self._twist[robot] = message.linear.x, 0.0, message.angular.z

        for robot, name in enumerate(self._robots):
            hear = functools.partial(drive, robot)
            graph.listen("geometry_msgs/msg/Twist", f"/{name}/cmd_vel", hear)
        odometry = "nav_msgs/msg/Odometry"
        self._odometry = [graph.publisher(odometry, f"/{name}/odom") for name in self._robots]
        rays = f"{MESSAGES}/msg/RobotClosestObstacle"
        topic = "robot_closest_obstacles"
        self._rays = [graph.publisher(rays, f"/{name}/{topic}") for name in self._robots]
        self._human_states = graph.publisher(f"{MESSAGES}/msg/HumanStates", "/human_states")

    def _publish(self, tick: dict[str, Any]) -> None:
        for robot, publisher in enumerate(self._odometry):
            publisher.publish(_odometry(tick["pose"][robot], tick["velocity"][robot]))
        self._human_states.publish(_people(tick, self._people))
        if tick["tick"] % self._ray_ticks == 0:
            for robot, publisher in enumerate(self._rays):
                publisher.publish(_obstacles(tick["obstacle_points"][robot]))

    def _stops(self, robot: int, tick: dict[str, Any]) -> list[dict[str, Any]]:
        """Hold a robot where it arrived until it has loaded; their nodes know no loading."""
        loading = self._loading[robot]
        loading += self._arrivals(robot)
        is_at_rest = np.abs(tick["velocity"][robot, :2]).max() <= AT_REST
        if not loading or not is_at_rest:
            self._rests_since[robot] = np.inf
            return []
        self._rests_since[robot] = min(self._rests_since[robot], tick["time"])
        service = self._service[loading[0]["task"]][loading[0]["kind"] == "dropped-off"]
        if tick["time"] - self._rests_since[robot] < service:
            return []
        self._rests_since[robot] = tick["time"]
        return [loading.pop(0)]

    def _arrivals(self, robot: int) -> list[dict[str, Any]]:
        """Give the stops that a robot says it has made since the last tick."""
        setter = self._graph.program("goal_setter").nodes[robot]
        events = []
        while self._arrived[robot] < len(setter.actual_arrival_times):
            self._arrived[robot] += 1
            plan = self._dispatcher.plans[-1]["agt"][robot]["id"]
            action = plan[self._arrived[robot]] - len(self._robots)
            kind = "dropped-off" if action % 2 else "picked-up"
            events.append({"kind": kind, "robot": robot, "task": self._tasks[action // 2]})
        return events

    def _changed_paths(self) -> list[list[Any]]:
        changed = []
        for robot, name in enumerate(self._robots):
            controller = self._graph.program(f"cbf_{name}").nodes[0]
            poses = controller.path.poses if controller.path_active else ()
            key = (id(poses), len(poses))
            if key != self._paths[robot]:
                self._paths[robot] = key
                points = [(p.pose.position.x, p.pose.position.y) for p in poses]
                changed.append([robot, np.array(points).reshape(-1, 2)])
        return changed


def _launches(robots: list[str]) -> list[Launch]:
    controllers = [
        Launch(
            name=f"cbf_{name}",
            target=f"{PACKAGE}.nav2_cbf_controller:main",
            parameters={"robot_name": name, "robot_list": [r for r in robots if r != name]},
        )
        for name in robots
    ]
    return [
        *controllers,
        Launch(
            name="goal_setter",
            target=f"{PACKAGE}.goal_setter:main",
            arguments=("-input_file", "setup.json"),
        ),
        Launch(name="room_queue", target=f"{PACKAGE}.room_queue:main"),
        Launch(
            name="planner_wrapper",
            target=f"{PACKAGE}.nav2_planner_wrapper:main",
            parameters={"robots": robots},
        ),
        Launch(name="init_planner", target=f"{PACKAGE}.init_planner:main"),
        Launch(
            name="dispatcher",
            target=f"{PACKAGE}.dispatcher:main",
            parameters={"input_file": "setup.json"},
        ),
    ]


def _write_files(world: dict[str, Any], checkout: Checkout, robots: list[str]) -> list[int]:
    """Write what their nodes read at the start, and go there; give the tasks in their order."""
    folder = Path(tempfile.mkdtemp(prefix="mrta-sim-"))
    for file in checkout.data:
        shutil.copy(file, folder)
    stream: list[dict[str, Any]] = []
    order = sorted(world["tasks"], key=lambda task: (task["arrival"], task["task"]))
    for task in order:
        arrival = int(task["arrival"])
        if not stream or stream[-1]["arrival"] != arrival:
            stream.append({"arrival": arrival, "tasks": []})
        told = {"start": task["start"], "end": task["end"], "deadline": int(task["deadline"])}
        stream[-1]["tasks"].append(told)
    points = np.array([room["point"] for room in world["rooms"]][:ROOMS])
    poses = [robot["pose"][:2] for robot in world["robots"]]
    starts = [int(np.hypot(*(points - np.array(pose)).T).argmin()) for pose in poses]
    agents = {name: {"start": pose} for name, pose in zip(robots, poses, strict=True)}
    (folder / "simulation").mkdir()
    (folder / CASE).write_text(json.dumps({"tasks_stream": stream, "agents": starts}))
    (folder / "setup.json").write_text(json.dumps({"agents": agents}))
    os.chdir(folder)
    return [task["task"] for task in order]


def _goal(setter: Any) -> tuple[float, float]:
    """Give where a robot wants to be: a room's point, or its place in the queue."""
    if setter.goal_room is None or setter.goal_idx >= len(setter.locs):
        return np.nan, np.nan
    spots, place = setter.queues[setter.goal_room], setter.queue_position
    point = spots[place - 1] if place and place <= len(spots) else None
    x, y = point or setter.room_positions[setter.goal_room]
    return float(x), float(y)


def _odometry(pose: np.ndarray, velocity: np.ndarray) -> Any:
    message = message_class("nav_msgs/msg/Odometry")()
    message.header.frame_id = "map"
    x, y, yaw = map(float, pose)
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    turn = message.pose.pose.orientation
    turn.z, turn.w = float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
    message.twist.twist.linear.x = float(velocity[0])
    message.twist.twist.angular.z = float(velocity[2])
    return message


def _people(tick: dict[str, Any], most: int) -> Any:
    message = message_class(f"{MESSAGES}/msg/HumanStates")()
    pose, twist = (message_class(f"geometry_msgs/msg/{name}") for name in ("Pose", "Twist"))
    present = np.flatnonzero(np.isfinite(tick["human_position"]).all(axis=1))[:most]
    for person in present:
        place, speed = pose(), twist()
        place.position.x, place.position.y = map(float, tick["human_position"][person])
        speed.linear.x, speed.linear.y = map(float, tick["human_velocity"][person])
        message.states.append(place)
        message.velocities.append(speed)
        message.valid.append(True)
    return message


def _obstacles(points: np.ndarray) -> Any:
    message = message_class(f"{MESSAGES}/msg/RobotClosestObstacle")()
    point = message_class("geometry_msgs/msg/Point")
    seen = points[np.isfinite(points).all(axis=1)]
    message.obstacle_locations = [point(x=float(x), y=float(y)) for x, y in seen]
    message.num_obstacles = len(seen)
    return message


def _share_compiled_functions(module: ModuleType) -> None:
    """Have controllers of one size share what JAX has compiled for one of them: speed alone."""
    kind = module.multi_cbf_controller
    kind.__hash__ = lambda self: hash((self.num_agents, self.n_base))
    kind.__eq__ = lambda self, other: (
        (self.num_agents, self.n_base) == (other.num_agents, other.n_base)
    )


def _settle_jax() -> None:
    """Have JAX keep what it compiles, for other runs and for copies of a run."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "mrta-falsify"
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_compilation_cache_dir", str(cache / "mrta-sim-jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _stand_in_for_licensed_solver() -> None:
    """Clarabel solves what Gurobi would; the differentiable layer is built and never called."""
    cvxpy.GUROBI = os.environ.get("MRTA_SOLVER", "CLARABEL")
    layers, jax_layers = ModuleType("cvxpylayers"), ModuleType("cvxpylayers.jax")
    jax_layers.CvxpyLayer = lambda *arguments, **options: None  # type: ignore[attr-defined]
    sys.modules["cvxpylayers"], sys.modules["cvxpylayers.jax"] = layers, jax_layers


def main() -> None:
    """Answer the harness."""
    source = os.environ.get("MRTA_SIM")
    if not source:
        sys.exit("MRTA_SIM must name the folder of a checkout of MRTA-Sim and SMrTa")
    checkout = Checkout(Path(source).resolve())
    for file in checkout.messages:
        DEFINITIONS.add(parse_interface(file.read_text(), f"{MESSAGES}/msg/{file.stem}"))
    _settle_jax()
    _stand_in_for_licensed_solver()
    says = ("deliveries", "goals", "paths")
    # JAX's threads do not survive a fork, so a copy of the run tells a fresh process everything.
    serve(functools.partial(MrtaSim, checkout), name="MRTA-Sim", says=says, can=())


if __name__ == "__main__":
    main()
