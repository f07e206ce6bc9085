"""Does meeting slow people down? Measured people, one way and both ways.

    git clone https://github.com/PedestrianDynamics/PedPy
    python -m experiments.people.measured PedPy/notebooks/demo-data

Reads trajectories of the Juelich experiments that PedPy (MIT) brings: people in a corridor of 1.8
m, all one way, with exits of several widths behind it, and in one of 4 m, both ways. Speed is the
way along the corridor in 1 s, density the number of people in 4 m of the corridor over its area.
Moments of like density are put together, weighted by people. Pickled files are not read.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.people.flows import weidmann
from mrta_falsify.core.arrays import Array

PART = 4.0  # m of the corridor, around its middle
HALF_STEP = 0.5  # s
BINS = np.arange(0.25, 2.3, 0.5)  # 1/m^2
MOMENTS = 100  # that a figure rests on at least
MIXED = 0.3  # share of those who are fewer, from which streams count as meeting


class Experiment(NamedTuple):
    """Files of one corridor, and how they are read."""

    files: tuple[str, ...]
    rate: float  #: pictures a second
    along: int  #: 0: the corridor runs along x, 1: along y
    width: float  #: [m]
    both_ways: bool


EXPERIMENTS = {
    "one way, 1.8 m, free exit": Experiment(
        ("uni-directional/uo-145-180-180.txt", "uni-directional/uo-180-180-180.txt"),
        16.0, 1, 1.8, False,
    ),
    "one way, 1.8 m, narrow exits": Experiment(
        tuple(f"uni-directional/uo-180-180-{exit}.txt" for exit in ("120", "095", "070")),
        16.0, 1, 1.8, False,
    ),
    "both ways, 4 m": Experiment(("bi-directional/bi_corr_400_b_03.txt",), 25.0, 0, 4.0, True),
}  # fmt: skip


def moments(path: Path, how: Experiment) -> Array:
    """Read density [1/m^2], mean speed [m/s], people and share of the fewer, ``(M, 4)``."""
    table = np.loadtxt(path, usecols=(0, 1, 2 + how.along))
    seen: dict[int, list[tuple[float, float]]] = {}
    step = round(HALF_STEP * how.rate)
    for person in np.unique(table[:, 0]):
        own = table[table[:, 0] == person]
        own = own[np.argsort(own[:, 1])]
        place = dict(zip(own[:, 1].astype(int).tolist(), own[:, 2] / 100.0, strict=True))
        way = float(np.sign(own[-1, 2] - own[0, 2]))
        for picture, at in place.items():
            if abs(at) < PART / 2.0:
                ends = place.get(picture - step, np.nan), place.get(picture + step, np.nan)
                moved = (ends[1] - ends[0]) * way * how.rate / (2 * step)
                seen.setdefault(picture, []).append((moved, way))
    rows = []
    for people in seen.values():
        speed, way = np.array(people).T
        if np.isfinite(speed).all():
            fewer = float(min((way > 0.0).mean(), (way < 0.0).mean()))
            rows.append((len(people) / (PART * how.width), speed.mean(), len(people), fewer))
    return np.array(rows)


def main() -> None:
    """Print speed over density of each experiment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    print("| Experiment | Density [1/m2] | Speed [m/s] | Off Weidmann's curve | Moments |")
    print("|---|---|---|---|---|")
    for name, how in EXPERIMENTS.items():
        rows = np.concatenate([moments(folder / file, how) for file in how.files])
        if how.both_ways:
            rows = rows[rows[:, 3] >= MIXED]
        for low, high in itertools.pairwise(BINS):
            part = rows[(rows[:, 0] >= low) & (rows[:, 0] < high)]
            if len(part) >= MOMENTS:
                at = float(part[:, 0].mean())
                speed = float(np.average(part[:, 1], weights=part[:, 2]))
                off = speed / weidmann(at) - 1.0
                print(f"| {name} | {at:.2f} | {speed:.2f} | {off:+.0%} | {len(part)} |")


if __name__ == "__main__":
    main()
