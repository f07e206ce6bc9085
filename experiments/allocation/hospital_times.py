"""Our travel times of the AWS hospital beside MRTA-Sim's published ones, and why they differ.

    mrta-falsify travel-times aws_hospital_day --iterations 3 -o TIMES.json
    python -m experiments.allocation.hospital_times TIMES.json

Per pair of rooms: both times, and the length of the way in both road networks (ours is the
repaired one that the robots drive, the published one is what MRTA-Sim drove).
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import World
from scenic_worlds.layouts import load_layout, load_world


def lengths(world: World) -> Array:
    """Lengths ``(R, R)`` [m] of the lanes from room point to room point."""
    found = np.zeros((len(world.rooms), len(world.rooms)))
    for lane in world.lanes:
        way = np.vstack([world.rooms[lane.start].point, lane.to_room])
        found[lane.start, lane.end] = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    return found


def speed_and_start(length: Array, time: Array) -> tuple[float, float]:
    """Least-squares ``time = start + length / speed``: speed [m/s], start [s]."""
    slope, start = np.polyfit(length, time, 1)
    return 1.0 / slope, start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("times", type=Path, help="as `travel-times aws_hospital_day` writes it")
    options = parser.parse_args()
    ours = np.array(codec.read_json(options.times)["travel_time"], dtype=np.float64)
    world = load_world("aws_hospital_day")
    published = world.travel_times
    roads, old_roads = lengths(world), lengths(load_layout("aws_hospital_as_published"))
    pairs = list(itertools.permutations(range(len(world.rooms)), 2))
    print("| from, to | published s | ours s | ratio | published roads m | ours m | ratio |")
    print("|---|---|---|---|---|---|---|")
    for i, j in pairs:
        print(
            f"| {i}, {j} | {published[i, j]:.0f} | {ours[i, j]:.1f} | "
            f"{ours[i, j] / published[i, j]:.2f} | {old_roads[i, j]:.1f} | {roads[i, j]:.1f} | "
            f"{roads[i, j] / old_roads[i, j]:.2f} |"
        )
    pick = tuple(np.array(pairs).T)
    ratio = ours[pick] / published[pick]
    print(
        f"\nours / published: median {np.median(ratio):.2f}, {ratio.min():.2f} to "
        f"{ratio.max():.2f}; correlation {np.corrcoef(ours[pick], published[pick])[0, 1]:.3f}; "
        f"mean difference {np.mean(ours[pick] - published[pick]):.1f} s"
    )
    for name, length, time in (
        ("published", old_roads[pick], published[pick]),
        ("ours", roads[pick], ours[pick]),
    ):
        speed, start = speed_and_start(length, time)
        error = np.abs(start + length / speed - time).max()
        print(
            f"{name}: {np.median(length / time):.2f} m/s on the median pair; time = {start:.1f} s "
            f"+ length / {speed:.2f} m/s within {error:.1f} s; there and back differ by up to "
            f"{np.abs(time_gap(time, pairs)).max():.1f} s"
        )


def time_gap(time: Array, pairs: list[tuple[int, int]]) -> Array:
    """Time there minus time back [s] per pair."""
    by_pair = dict(zip(pairs, time, strict=True))
    return np.array([by_pair[i, j] - by_pair[j, i] for i, j in pairs])


if __name__ == "__main__":
    main()
