"""How fast every layer is on this machine: what ``bench`` prints.

Layers are measured through their protocols, so any registered implementation can be timed.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import platform
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.fleet import Command, Frame
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.protocols import Controller, ControlView, Planner
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import Furniture, RobotSpec, Task, World
from mrta_falsify.stack.control.steering import Scene, Steering
from scenic_worlds.layouts import load_world
from scenic_worlds.variation import vary_world
from simulator_interface.episode import Episode

WORLD = "aws_hospital_day"
WINDOW = 10.0  # s, "minimum over any 10 s"
QP_FLEETS = (1, 2, 3, 6)  # robots in one cluster, as in MRTA-Sim's table
QP_CALLS = 400
SPACING = 1.2  # m between added robots
TRIPS = 40  # planned start and goal pairs


def step_count(fleets: Sequence[int]) -> int:
    """Number of steps that :func:`bench` reports on the way."""
    return len(fleets) + len(QP_FLEETS) + 4


def bench(
    config: StackConfig | None = None,
    *,
    fleets: Sequence[int] = (2, 4, 6, 12, 24),
    seconds: float = 60.0,
    on_progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Measure every layer on one core.

    Args:
        config: the stack; the default stack if None.
        fleets: numbers of robots to run with all layers and 8 people.
        seconds: simulated time per fleet [s], >= 10.
        on_progress: called with the number of finished steps.

    Returns:
        ``real_time_factor`` {robots: {mean, min over any 10 s, busy_min: the same over the
        ticks at which all robots have tasks and a cluster of three exists, None if they
        are less than 1 s}},
        ``engine_real_time_factor`` {robots: factor}, ``cbf_qp_ms`` {robots in a cluster:
        {p50, p99} of assembly and solve}, ``control_ms`` (the same for the whole
        controller), ``qp_init_ms``, ``plan_ms`` {cold_p95, warm_p95}, ``costmap_ms``,
        ``first_tick_ms`` (world with unseen furniture to first tick) and ``machine``.
    """
    config = config or StackConfig()
    world = vary_world(load_world(WORLD), 0)
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if on_progress is not None:
            on_progress(done)

    _warm_up(world, config)
    step()
    data: dict[str, Any] = {"real_time_factor": {}, "cbf_qp_ms": {}, "control_ms": {}}
    for robots in fleets:
        data["real_time_factor"][str(robots)] = _time_fleet(world, config, robots, seconds)
        step()
    for robots in QP_FLEETS:
        whole, program = _time_controller(config, robots)
        data["control_ms"][str(robots)], data["cbf_qp_ms"][str(robots)] = whole, program
        step()
    data["qp_init_ms"] = _time_controller_init(config)
    data["plan_ms"] = _time_planner(world, config)
    step()
    data["costmap_ms"] = _time_costmap(world, config)
    data["first_tick_ms"] = _time_first_tick(world, config)
    step()
    data["engine_real_time_factor"] = {
        "6": _time_engine(_fleet_world(world, config, 6), config, min(seconds, 30.0))
    }
    step()
    data["world"] = WORLD
    data["machine"] = machine()
    return data


def machine() -> dict[str, Any]:
    """What the figures depend on."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.partition(":")[2].strip() for line in file if "model name" in line]
        model = names[0] if names else model
    except OSError:
        pass
    return {
        "cpu": model,
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }


# --- whole stack -----------------------------------------------------------------------


def _warm_up(world: World, config: StackConfig) -> None:
    """Compile or load compiled code, so that no figure contains it."""
    for tick, _ in enumerate(_frames(dataclasses.replace(world, horizon=5.0), config)):
        if tick >= 40:
            break


def _frames(world: World, config: StackConfig) -> Any:
    return Episode(world, config).frames()


def _time_fleet(world: World, config: StackConfig, robots: int, seconds: float) -> dict[str, Any]:
    """Real-time factors of a whole run: mean, worst window, worst busy window."""
    ticks = round(seconds * config.control_rate)
    spent, busy = np.empty(ticks), np.empty(ticks, dtype=bool)
    frames = _frames(_fleet_world(world, config, robots), config)
    next(frames)
    for tick in range(ticks):
        before = time.perf_counter()
        frame = next(frames)
        spent[tick] = time.perf_counter() - before
        busy[tick] = _is_busy(frame)
    frames.close()
    dt = 1.0 / config.control_rate
    return {
        "mean": round(ticks * dt / float(spent.sum()), 2),
        "min": _worst_factor(spent, dt),
        "busy_min": _worst_factor(spent[busy], dt) if busy.sum() * dt >= 1.0 else None,
        "tick_p50_ms": _ms(spent, 50.0),
        "tick_p99_ms": _ms(spent, 99.0),
    }


def _worst_factor(spent: Array, dt: float) -> float:
    """Smallest real-time factor over any ``WINDOW`` of consecutive entries of ``spent`` [s]."""
    width = min(round(WINDOW / dt), len(spent))
    sums = np.convolve(spent, np.ones(width), mode="valid")
    return round(width * dt / float(sums.max()), 2)


def _is_busy(frame: Frame) -> bool:
    """All robots have work, and at least three form one cluster."""
    _, sizes = np.unique(frame.intent.cluster, return_counts=True)
    return bool((frame.intent.tasks_left > 0).all() and sizes.max(initial=0) >= 3)


def _fleet_world(world: World, config: StackConfig, robots: int) -> World:
    """``world`` with so many robots, and tasks enough to keep them all busy."""
    fleet = list(world.robots[:robots])
    free = _free_places(world, config, robots - len(fleet))
    for i, place in enumerate(free):
        fleet.append(
            RobotSpec(
                name=f"extra{i + 1}", pose=frozen_array([*place, 0.0]), radius=fleet[0].radius
            )
        )
    rooms = len(world.rooms)
    tasks = [
        Task(
            arrival=0.0,
            start=i % rooms,
            end=(i + 1 + i // rooms % (rooms - 1)) % rooms,
            deadline=3600.0,
        )
        for i in range(4 * robots)
    ]
    return dataclasses.replace(
        world, robots=tuple(fleet), tasks=tuple(tasks), horizon=3600.0, name=f"bench_{robots}"
    )


def _free_places(world: World, config: StackConfig, count: int) -> list[Array]:
    """Points ``(2,)`` [m] clear of obstacles, of robots and of each other, on reachable floor."""
    if count <= 0:
        return []
    costmap = _costmap(world, config)
    planner = _planner(config, costmap)
    cells = np.argwhere(costmap.cost == 0)
    order = stream(0, "bench/places").permutation(len(cells))
    taken = [robot.pose[:2] for robot in world.robots]
    found: list[Array] = []
    for point in costmap.centers(cells[order]):
        if len(found) == count:
            return found
        if min(float(np.hypot(*(point - other))) for other in taken) < SPACING:
            continue
        if planner.plan(point, world.rooms[0].point).found:
            taken.append(point)
            found.append(point)
    raise ConfigError(f"{world.name}: has no room for {count} more robots")


# --- single layers -----------------------------------------------------------------------


def _costmap(world: World, config: StackConfig) -> Costmap:
    built: Costmap = (
        registry.build("costmap", config.costmap).bind(world).costmap(0.0, np.zeros((0, 2)))
    )
    return built


def _planner(config: StackConfig, costmap: Costmap) -> Planner:
    planner: Planner = registry.build("planner", config.planner)
    planner.use(costmap)
    return planner


def _time_costmap(world: World, config: StackConfig) -> float:
    """Costmap of a world never seen; median of ten."""
    worlds = [_with_new_furniture(world, number) for number in range(10)]
    spent = [_timed(functools.partial(_costmap, changed, config)) for changed in worlds]
    return _ms(np.array(spent), 50.0)


def _time_planner(world: World, config: StackConfig) -> dict[str, float]:
    """Cold: first plan to a goal; warm: another plan to a goal seen before."""
    planner = _planner(config, _costmap(world, config))
    random = stream(0, "bench/trips")
    rooms = [room.point for room in world.rooms]
    jitter = random.uniform(-0.2, 0.2, size=(TRIPS, 2))
    cold, warm = [], []
    for i in range(TRIPS):
        start, goal = rooms[i % len(rooms)], rooms[(i + 1 + i // 6) % len(rooms)] + jitter[i]
        cold.append(_timed(functools.partial(planner.plan, start, goal)))
        other = rooms[(i + 2) % len(rooms)]
        warm.append(_timed(functools.partial(planner.plan, other, goal)))
    return {"cold_p95": _ms(np.array(cold), 95.0), "warm_p95": _ms(np.array(warm), 95.0)}


def _time_first_tick(world: World, config: StackConfig) -> float:
    """From a world with furniture never seen to the first tick; median of five."""
    spent = []
    for number in range(5):
        changed = _with_new_furniture(world, 100 + number)
        before = time.perf_counter()
        frames = _frames(changed, config)
        next(frames)
        next(frames)
        spent.append(time.perf_counter() - before)
        frames.close()
    return _ms(np.array(spent), 50.0)


def _with_new_furniture(world: World, number: int) -> World:
    """``world`` with up to five more trolleys, at places that depend on ``number``."""
    places = stream(number, "bench/furniture").uniform(
        world.bounds[:2] + 1.0, world.bounds[2:] - 1.0, size=(5, 2)
    )
    extra = tuple(
        Furniture(
            name=f"bench{number}_{i}",
            kind="trolley",
            polygon=frozen_array(transform(rectangle(0.9, 0.6), (*place, 0.3 * i))),
        )
        for i, place in enumerate(places)
        if _is_clear(place, world)
    )
    return dataclasses.replace(world, furniture=(*world.furniture, *extra))


def _is_clear(place: Array, world: World) -> bool:
    actors = [robot.pose[:2] for robot in world.robots] + [human.route[0] for human in world.humans]
    return all(np.hypot(*(place - other)) > 2.0 for other in actors)


def _time_engine(world: World, config: StackConfig, seconds: float) -> float:
    """Real-time factor of the engine alone: every robot drives a slow circle."""
    engine = registry.build("engine", config.engine)
    dt = 1.0 / config.control_rate
    people = np.array([human.route[0] for human in world.humans]).reshape(-1, 2)
    command = Command(twist=np.tile([0.1, 0.0, 0.5], (len(world.robots), 1)))
    still = np.zeros_like(people)
    try:
        engine.start(world, dt, people)
        ticks = round(seconds / dt)
        spent = _timed(lambda: [engine.step(command, still) for _ in range(ticks)])
    finally:
        engine.close()
    return round(seconds / spent, 1)


# --- controller ----------------------------------------------------------------------------


def _time_controller(config: StackConfig, robots: int) -> tuple[dict[str, float], Any]:
    """One tick with all robots in one cluster: the whole controller, and its program alone.

    The program is assembly of all rows and one solve for all robots, without the shortcuts
    (no solver where the reference obeys every row, components one by one) that the
    controller takes; None for a controller that does not use ours.
    """
    controller = _controller(config)
    views = _control_views(robots)
    for view in views[:20]:
        controller.control(view)
    spent = np.array([_timed(functools.partial(controller.control, view)) for view in views])
    return _percentiles(spent), _time_program(_controller(config), views)


@runtime_checkable
class _BarrierController(Controller, Protocol):
    """A controller built on our barrier program, whose parts can be timed alone."""

    steering: Steering

    def scene(self, view: ControlView) -> Scene:
        """What is steered at this tick."""


def _time_program(controller: Controller, views: Sequence[ControlView]) -> dict[str, float] | None:
    """Assembly of limits and rows, and one solve for all robots."""
    if not isinstance(controller, _BarrierController):
        return None
    steering = controller.steering
    spent = []
    for view in views:
        scene = controller.scene(view)
        before = time.perf_counter()
        program = steering.program(view, scene)
        assembled = time.perf_counter() - before
        joint = program.as_one()
        before = time.perf_counter()
        steering.solve(joint, always=True)
        spent.append(assembled + time.perf_counter() - before)
        controller.control(view)
    return _percentiles(np.array(spent[20:]))


def _percentiles(seconds: Array) -> dict[str, float]:
    return {"p50": _ms(seconds, 50.0), "p99": _ms(seconds, 99.0)}


def _time_controller_init(config: StackConfig) -> float:
    """First call of a fresh controller that leads a cluster of three; median of five."""
    view = _control_views(3)[0]
    spent = [_timed(lambda: _controller(config).control(view)) for _ in range(5)]
    return _ms(np.array(spent), 50.0)


def _controller(config: StackConfig) -> Controller:
    built: Controller = registry.build("controller", config.controller, defects=config.defects)
    return built


def _control_views(robots: int) -> list[ControlView]:
    """A tight group that drives through a corridor past two people; each tick differs a bit."""
    random = stream(robots, "bench/control")
    angles = np.arange(12) * np.pi / 6.0
    rays = 1.2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ahead = np.array([5.0, 0.0])
    views = []
    for tick in range(QP_CALLS):
        columns, rows = np.divmod(np.arange(robots), 2)
        place = np.stack([1.3 * columns + 0.02 * tick, 1.3 * rows], axis=1)
        place = place + random.normal(scale=0.01, size=place.shape)
        pose = np.column_stack([place, random.normal(scale=0.05, size=robots)])
        target = place + np.array([0.5, 0.0])
        views.append(
            ControlView(
                time=0.05 * tick,
                dt=0.05,
                pose=pose,
                velocity=np.tile([0.6, 0.0, 0.0], (robots, 1)),
                target=target,
                goal=place + ahead,
                path=tuple(np.array([p, p + ahead]) for p in place),
                active=np.ones(robots, dtype=bool),
                present=np.ones(robots, dtype=bool),
                rank=np.arange(robots),
                obstacle_points=place[:, None] + rays,
                human_position=place[0] + np.array([[1.5, -0.9], [2.5, 1.0]]),
                human_velocity=np.array([[-1.0, 0.0], [-0.8, 0.0]]),
                human_radius=np.array([0.25, 0.25]),
                states_link=np.ones(robots, dtype=bool),
                leader_link=np.ones(robots, dtype=bool),
                max_speed=np.full(robots, 1.5),
                max_acceleration=np.ones(robots),
                max_turn_rate=np.full(robots, 2.0),
            )
        )
    return views


# --- time ----------------------------------------------------------------------------------


def _timed(work: Callable[[], Any]) -> float:
    before = time.perf_counter()
    work()
    return time.perf_counter() - before


def _ms(seconds: Array, percentile: float) -> float:
    return round(1000.0 * float(np.percentile(seconds, percentile)), 3)
