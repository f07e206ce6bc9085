"""Costmap and planner timings on the AWS hospital floor.

    python benchmarks/planning/bench.py [--format json] [--count 60]

Medians and 95th percentiles in milliseconds; compilation is done before anything is timed.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import World
from mrta_falsify.stack.planning.astar import AStar
from mrta_falsify.stack.planning.ompl import Ompl
from scenic_worlds.layouts import load_world
from simulator_interface.costmap_layers import BoundCostmap, CostmapOptions

Summary = dict[str, float]


def milliseconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - began)


def summary(times: list[float]) -> Summary:
    p50, p95 = np.percentile(times, [50, 95])
    return {"p50": round(float(p50), 3), "p95": round(float(p95), 3), "max": round(max(times), 3)}


def places_of(world: World) -> Array:
    """Room points, waiting spots and parking spots ``(n, 2)`` [m]."""
    spots = [resource.spots for resource in world.resources if len(resource.spots)]
    return np.concatenate([[room.point for room in world.rooms], *spots, world.parking])


def copy_of(world: World) -> World:
    """The same world as a new object: nothing is cached for it."""
    return dataclasses.replace(world)


def refurnished(world: World, seed: int) -> World:
    """``world`` with every piece of furniture moved by up to 0.1 m per axis: an unseen map."""
    random = stream(seed, "furniture")
    furniture = tuple(
        dataclasses.replace(
            item, polygon=frozen_array(item.polygon + random.uniform(-0.1, 0.1, size=2))
        )
        for item in world.furniture
    )
    return dataclasses.replace(world, furniture=furniture)


def bench_costmap(world: World, count: int) -> dict[str, Summary]:
    options, random, nobody = CostmapOptions(), stream(0, "parked"), np.zeros((0, 2))
    build = [milliseconds(lambda: BoundCostmap(copy_of(world), options)) for _ in range(count)]
    source = BoundCostmap(world, options)
    places = places_of(world)
    update = []
    for _ in range(count):
        parked = random.permutation(places)[:3] + random.uniform(-0.1, 0.1, size=(3, 2))
        update.append(milliseconds(lambda parked=parked: source.costmap(0.0, parked)))
    unchanged = [milliseconds(lambda: source.costmap(1.0, nobody)) for _ in range(count)]
    return {"build": summary(build), "update_3_parked": summary(update), "same": summary(unchanged)}


def bench_planner(world: World, planner: Any, count: int) -> dict[str, Summary]:
    costmap = BoundCostmap(world, CostmapOptions()).costmap(0.0, np.zeros((0, 2)))
    random, places = stream(0, "queries"), places_of(world)
    queries = [random.permutation(places)[:2] for _ in range(count)]
    cold, warm = [], []
    known = planner(planner.Options())
    known.use(costmap)
    for start, goal in queries:
        fresh = planner(planner.Options())
        fresh.use(costmap)
        cold.append(milliseconds(lambda s=start, g=goal, p=fresh: p.plan(s, g)))
        known.plan(start, goal)
        near = start + random.uniform(-0.1, 0.1, size=2)
        warm.append(milliseconds(lambda s=near, g=goal: known.plan(s, g)))
    return {"cold": summary(cold), "warm": summary(warm)}


def bench_first_plans(world: World, count: int) -> dict[str, Summary]:
    """What an unseen furniture arrangement costs before the first tick."""
    build, plans, spots = [], [], world.parking
    for seed in range(count):
        changed, planner = refurnished(world, seed), AStar(AStar.Options())
        began = time.perf_counter()
        costmap = BoundCostmap(changed, CostmapOptions()).costmap(0.0, np.zeros((0, 2)))
        planner.use(costmap)
        build.append(1e3 * (time.perf_counter() - began))
        rooms = [room.point for room in changed.rooms]
        order = stream(seed, "tasks").permutation(len(rooms))
        began = time.perf_counter()
        for robot, goal in enumerate(order):
            planner.plan(spots[robot], rooms[goal])
        plans.append(1e3 * (time.perf_counter() - began))
    return {"map_and_grid": summary(build), "six_plans": summary(plans)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--format", choices=["text", "json"], default="text")
    parser.add_argument("--count", type=int, default=60)
    arguments = parser.parse_args()
    world, count = load_world("aws_hospital_day"), arguments.count
    bench_costmap(world, 2)  # compile
    for planner in (AStar, Ompl):
        bench_planner(world, planner, 3)
    results = {
        "costmap_ms": bench_costmap(world, count),
        "astar_ms": bench_planner(world, AStar, count),
        "ompl_ms": bench_planner(world, Ompl, count // 3),
        "unseen_furniture_ms": bench_first_plans(world, count // 3),
    }
    if arguments.format == "json":
        print(json.dumps(results))
        return
    for group, rows in results.items():
        for name, row in rows.items():
            figures = "  ".join(f"{key} {value:9.3f}" for key, value in row.items())
            print(f"{group:22s} {name:16s} {figures}")


if __name__ == "__main__":
    main()
