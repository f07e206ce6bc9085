"""One table of the streams of :mod:`experiments.people.flows`, walked by several simulators."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from experiments.people.flows import DENSITIES, Flow, measure, weidmann


class Walking(Protocol):
    """Measures one stream in one simulator."""

    def __call__(self, density: float, width: float, *, both_ways: bool, seed: int) -> Flow: ...


def stream_arguments(doc: str) -> argparse.ArgumentParser:
    """Parse which streams to walk."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--densities", type=float, nargs="*", default=DENSITIES)
    parser.add_argument("--widths", type=float, nargs="*", default=(2.4, 3.6))
    return parser


def print_table(others: Mapping[str, Walking], options: argparse.Namespace) -> None:
    """Print speed, share off Weidmann's curve, and share of people that touch, for each stream.

    Args:
        others: simulators beside `by_sight`, by the names of their columns.
        options: of :func:`stream_arguments`.
    """
    ours: Walking = functools.partial(measure, model="by_sight")
    simulators = {"by_sight": ours, **others}
    print("| Stream | Corridor | Wanted [1/m2] | " + " | ".join(simulators) + " |")
    print("|---" * (3 + len(simulators)) + "|")
    for both_ways in (False, True):
        for width in options.widths:
            for density in options.densities:
                cells = [
                    _cell(
                        [
                            walking(density, width, both_ways=both_ways, seed=seed)
                            for seed in range(options.seeds)
                        ]
                    )
                    for walking in simulators.values()
                ]
                stream = "counterflow" if both_ways else "one way"
                print(
                    f"| {stream} | {width} m | {density} | " + " | ".join(cells) + " |", flush=True
                )


def _cell(flows: list[Flow]) -> str:
    at = float(np.mean([flow.density for flow in flows]))
    speed = float(np.mean([flow.speed for flow in flows]))
    share = float(np.mean([flow.touching for flow in flows]))
    return f"{speed:.2f} m/s at {at:.2f}, {speed / weidmann(at) - 1.0:+.0%}, {share:.0%}"
