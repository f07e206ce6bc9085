"""Drives small fleets over every kind of layout: are all tasks done, does anybody touch a wall?

Run: ``python benchmarks/scenic/layouts.py [--engine kinematic] [--seeds 3] [--only NAME]``
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.polyline import path_length
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import RobotSpec, Task, World
from mrta_falsify.specs.library import default_specifications
from mrta_falsify.trial import Job, run_job
from mrta_falsify.verbs.travel_times import measure_travel_times
from scenic_worlds.layouts import load_layout
from scenic_worlds.layouts.hospital import hospital
from scenic_worlds.layouts.store import department_store
from scenic_worlds.layouts.warehouse import warehouse

SERVICE = 3.0  # s, loading and unloading


def line(seed: int) -> World:
    return hospital(shape="line", rooms=6, **_lengths(seed))


def ell(seed: int) -> World:
    return hospital(shape="ell", rooms=8, **_lengths(seed))


def ring(seed: int) -> World:
    return hospital(shape="ring", rooms=8, lifts=1, **_lengths(seed))


def comb(seed: int) -> World:
    return hospital(shape="comb", rooms=8, chargers=1, **_lengths(seed))


def narrow(seed: int) -> World:
    """Everything at its narrowest."""
    return hospital(
        shape="ring", rooms=6, corridor_width=1.8, room_width=2.5, room_depth=2.6,
        door_width=0.8, spots=2, bathroom=1.0, door_offset=(0.0, 1.0), lifts=1,
    )  # fmt: skip


def shelves(seed: int) -> World:
    random = stream(seed, "bench/shelves")
    return warehouse(
        aisles=int(random.integers(2, 5)),
        picks=6,
        aisle_width=float(random.uniform(1.8, 4.0)),
        cross_width=float(random.uniform(1.8, 4.0)),
        pick_offset=float(random.uniform()),
        chargers=2,
    )


def shops(seed: int) -> World:
    random = stream(seed, "bench/shops")
    return department_store(
        departments=5,
        islands=int(random.integers(1, 4)),
        counters=2,
        aisle_width=float(random.uniform(1.8, 4.5)),
        cross_width=float(random.uniform(1.8, 4.5)),
        opening=random.uniform(1.0, 3.6, 5).tolist(),
        opening_offset=random.uniform(0.0, 1.0, 5).tolist(),
    )


LAYOUTS: dict[str, Callable[[int], World]] = {
    "line": line,
    "ell": ell,
    "ring": ring,
    "comb": comb,
    "narrow": narrow,
    "warehouse": shelves,
    "store": shops,
}


def _floor(name: str, seed: int) -> World:
    del seed
    return load_layout(name)


def _lengths(seed: int) -> dict[str, object]:
    random = stream(seed, "bench/lengths")
    return {
        "corridor_width": float(random.uniform(1.8, 4.5)),
        "cross_width": float(random.uniform(1.8, 4.5)),
        "room_width": random.uniform(4.0, 8.0, 8).tolist(),
        "room_depth": random.uniform(2.8, 6.0, 8).tolist(),
        "door_width": random.uniform(0.8, 1.8, 8).tolist(),
        "door_offset": random.uniform(0.0, 1.0, 8).tolist(),
        "bathroom": random.uniform(0.0, 1.0, 8).tolist(),
    }


def populated(layout: World, seed: int, *, robots: int = 5, tasks: int = 10) -> World:
    """A layout with robots in the first rooms and parking places, and random tasks."""
    random = stream(seed, "bench/tasks")
    places = [*(room.point for room in layout.rooms), *layout.parking][:robots]
    rooms = len(layout.rooms)
    stream_of_tasks = []
    for i in range(tasks):
        start, end = random.choice(rooms, 2, replace=False).tolist()
        stream_of_tasks.append(
            Task(
                arrival=float(round(i * 4.0 * random.uniform(), 1)), start=start, end=end,
                deadline=900.0, pickup_time=SERVICE, dropoff_time=SERVICE,
            )
        )  # fmt: skip
    return dataclasses.replace(
        layout,
        robots=tuple(
            RobotSpec(name=f"robot{i + 1}", pose=frozen_array([*place, 0.0]))
            for i, place in enumerate(places)
        ),
        tasks=tuple(stream_of_tasks),
        horizon=900.0,
        seed=seed,
    )


def drive(world: World, engine: str) -> dict[str, object]:
    config = StackConfig(engine=Choice(name=engine))
    before = time.process_time()
    outcome = run_job(Job(world=world, config=config, specifications=default_specifications()))
    violated = [verdict.spec for verdict in outcome.verdicts if verdict.violated]
    return {
        "ended": outcome.ended,
        "tasks": f"{outcome.tasks.completed}/{outcome.tasks.total}",
        "sim_s": round(outcome.sim_time, 1),
        "contacts": dict(outcome.contacts),
        "violated": violated,
        "cpu_s": round(time.process_time() - before, 1),
    }


def trip_times(layout: World, rooms: int, engine: str) -> list[tuple[float, float, float]]:
    """(length, derived time, driven time) of trips between the first rooms, alone."""
    few = dataclasses.replace(
        layout,
        rooms=layout.rooms[:rooms],
        lanes=tuple(lane for lane in layout.lanes if max(lane.start, lane.end) < rooms),
        resources=tuple(r for r in layout.resources if r.room is not None and r.room < rooms),
        travel_times=frozen_array(layout.travel_times[:rooms, :rooms]),
    )
    measured = measure_travel_times(few, StackConfig(engine=Choice(name=engine)), iterations=1)
    found = []
    for lane in few.lanes:
        way = np.vstack([few.rooms[lane.start].point, lane.to_room])
        driven = measured.matrix("mean")[lane.start, lane.end]
        derived = few.travel_times[lane.start, lane.end]
        found.append((path_length(way), float(derived), float(driven)))
    return found


def compare_times(floors: dict[str, Callable[[int], World]], engine: str) -> None:
    everything = []
    for name, make in floors.items():
        trips = np.array(trip_times(make(1), 4, engine))
        everything.append(trips)
        ratio = trips[:, 2] / trips[:, 1]
        print(
            f"{name}: driven / derived median {np.median(ratio):.2f}, "
            f"{ratio.min():.2f} to {ratio.max():.2f}, {len(trips)} trips of "
            f"{trips[:, 0].min():.0f} to {trips[:, 0].max():.0f} m",
            flush=True,
        )
    trips = np.vstack(everything)
    slope, offset = np.polyfit(trips[:, 0], trips[:, 2], 1)
    rest = trips[:, 2] - (slope * trips[:, 0] + offset)
    print(
        f"all: {len(trips)} trips, driven = length / {1.0 / slope:.2f} m/s + {offset:.1f} s, "
        f"spread {rest.std():.1f} s; correlation with derived "
        f"{np.corrcoef(trips[:, 1], trips[:, 2])[0, 1]:.3f}"
    )


def build_ms(make: Callable[[int], World], seeds: int) -> float:
    times = []
    for seed in range(max(seeds, 5)):
        before = time.process_time()
        make(seed)
        times.append(time.process_time() - before)
    return round(1e3 * statistics.median(times), 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", default="kinematic")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--robots", type=int, default=5)
    parser.add_argument("--only", default="")
    parser.add_argument("--output", type=Path)
    parser.add_argument("--floor", action="append", default=[], help="a layout's name or file")
    parser.add_argument("--travel-times", action="store_true", help="derived against driven")
    given = parser.parse_args()
    rows = []
    floors = {floor: functools.partial(_floor, floor) for floor in given.floor}
    chosen = floors or {k: v for k, v in LAYOUTS.items() if k in given.only.split(",")} or LAYOUTS
    if given.travel_times:
        compare_times(chosen, given.engine)
        return
    for name, make in chosen.items():
        print(f"{name}: {build_ms(make, given.seeds)} ms per layout", flush=True)
        for seed in range(given.first, given.first + given.seeds):
            row = {
                "layout": name,
                "seed": seed,
                **drive(populated(make(seed), seed, robots=given.robots), given.engine),
            }
            rows.append(row)
            print(json.dumps(row), flush=True)
    if given.output:
        given.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
