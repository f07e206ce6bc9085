"""The harder public set of allocation instances, made anew from a seed.

    python -m experiments.allocation.generate -o DIR [--seed 0] [--count 5]

Task files as SMrTa's, with the travel times they belong to. Families: `tight` (deadlines
scaled to both sides of the edge), `common` (one deadline for all, where counting decides),
`overload` (a stream with more work than the fleet can do), `late` (a stream to be run with
injected delays), `hot` (most tasks in three rooms), each with capacities 1 to 4 in its name.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.seeding import stream
from mrta_falsify.stack.allocation.timing import closed_travel_times

ROOMS = 40
SIDE = 60.0  # s from one end of the floor to the other, along one axis


@dataclass(frozen=True)
class Instance:
    """One task file."""

    name: str
    capacity: int
    data: dict[str, Any]


def travel_times(seed: int, rooms: int = ROOMS) -> Array:
    """Asymmetric travel times ``(rooms, rooms)`` [s], whole and closed."""
    random = stream(seed, "allocation/floor")
    points = random.uniform(0.0, SIDE, (rooms, 2))
    away = np.abs(points[:, None] - points[None]).sum(axis=2) * random.uniform(
        1.0, 1.15, (rooms, rooms)
    )
    times = np.ceil(away)
    np.fill_diagonal(times, 0.0)
    return closed_travel_times(times)


def _tasks(random, times, arrival, count, slack, rooms=None):
    tasks = []
    for _ in range(count):
        pool = len(times) if rooms is None else rooms
        start, end = (int(room) for room in random.choice(pool, 2, replace=False))
        ride = int(times[start, end]) + 2
        deadline = arrival + ride + int(random.integers(*slack))
        tasks.append({"start": start, "end": end, "deadline": deadline})
    return tasks


def _starts(random, times, robots):
    return [int(room) for room in random.integers(len(times), size=robots)]


def instances(seed: int = 0, count: int = 5) -> Iterator[Instance]:
    """All instances; ``count`` per shape."""
    times = travel_times(seed)
    for number in range(count):
        for tasks, robots in ((10, 3), (15, 5), (20, 5), (20, 10), (30, 10), (30, 20)):
            for scale in (1.0, 0.8, 0.65, 0.5):
                capacity = 1 + (number + tasks) % 4
                random = stream(seed, f"allocation/tight/{tasks}/{robots}/{number}")
                load = 70 * tasks // robots
                batch = _tasks(random, times, 0, tasks, (load // 2, 2 * load))
                for task in batch:
                    ride = int(times[task["start"], task["end"]]) + 2
                    task["deadline"] = max(ride, int(scale * task["deadline"]))
                yield Instance(
                    f"tight_t{tasks}_a{robots}_q{capacity}_x{scale:g}-{number}",
                    capacity,
                    {
                        "agents": _starts(random, times, robots),
                        "tasks_stream": [{"arrival": 0, "tasks": batch}],
                    },
                )
        for tasks, robots, horizon in ((10, 3, 240), (15, 5, 220), (20, 10, 160), (30, 15, 165)):
            for step in (1.0, 0.9, 0.8, 0.7):
                random = stream(seed, f"allocation/common/{tasks}/{robots}/{number}")
                batch = _tasks(random, times, 0, tasks, (0, 1))
                for task in batch:
                    task["deadline"] = int(horizon * step)
                yield Instance(
                    f"common_t{tasks}_a{robots}_q2_h{int(horizon * step)}-{number}",
                    2,
                    {
                        "agents": _starts(random, times, robots),
                        "tasks_stream": [{"arrival": 0, "tasks": batch}],
                    },
                )
        for family, per_batch, slack, rooms in (
            ("overload", 40, (80, 200), None),
            ("late", 10, (60, 200), None),
            ("hot", 10, (60, 200), 3),
        ):
            for capacity in (1, 2, 3, 4):
                random = stream(seed, f"allocation/{family}/{capacity}/{number}")
                batches = [
                    {
                        "arrival": 80 * b,
                        "tasks": _tasks(random, times, 80 * b, per_batch, slack, rooms),
                    }
                    for b in range(10)
                ]
                yield Instance(
                    f"{family}_n10_a20_q{capacity}-{number}",
                    capacity,
                    {"agents": _starts(random, times, 20), "tasks_stream": batches},
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=5)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    times = travel_times(options.seed).astype(int).tolist()
    table = {"units": "s", "statistic": "max", "travel_time": times}
    (options.output / "travel_times.json").write_text(json.dumps(table) + "\n")
    written = 0
    for instance in instances(options.seed, options.count):
        path = options.output / f"{instance.name}.json"
        path.write_text(json.dumps(instance.data, indent=1) + "\n")
        written += 1
    print(f"{written} instances in {options.output}")


if __name__ == "__main__":
    main()
