"""Draw where the time of a run goes, from the samples of py-spy, as a flame graph.

    py-spy record -r 500 -f raw -o samples.txt -- mrta-falsify run WORLD --set engine=kinematic
    python -m benchmarks.engine.flame samples.txt docs/pictures/flame_kinematic.png

py-spy is from PyPI. Widths are shares of the time in `EpisodeRun.advance`, which is a tick; copies
of the run are processes of their own and are not in it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

ROOT = "EpisodeRun.advance"
LOADING = ("_compile_for_args", "_find_and_load")  # paid once per process
LEAST = 0.004  # share below which a frame is left out
NAMED = 0.022  # share from which a frame has its name in it
DEPTH = 11
COLOURS = {
    "mrta_falsify/stack": "#4e79a7",
    "mrta_falsify/specs": "#e15759",
    "simulator_interface/engines": "#59a14f",
    "simulator_interface/people": "#76b7b2",
    "simulator_interface": "#bab0ac",
    "mrta_falsify": "#9c755f",
}


@dataclass(slots=True)
class Call:
    """A function, under what called it."""

    samples: int = 0
    below: dict[str, Call] = field(default_factory=dict)


def tree_of(lines: Iterable[str]) -> Call:
    """Add up py-spy's raw stacks, each `frame;frame;... samples`, from ``ROOT`` on."""
    root = Call()
    for line in lines:
        stack, _, samples = line.rpartition(" ")
        frames = [frame.rpartition(":")[0].strip() for frame in stack.split(";")]
        start = next((i for i, frame in enumerate(frames) if frame.startswith(ROOT)), None)
        if start is None or any(name in stack for name in LOADING):
            continue
        call = root
        call.samples += int(samples)
        for frame in frames[start + 1 :]:
            call = call.below.setdefault(frame, Call())
            call.samples += int(samples)
    return root


def draw(root: Call, output: Path) -> None:
    """Draw a tree of calls: callers above, the widest call first."""
    figure, axes = plt.subplots(figsize=(16, 6.5))

    def add(call: Call, left: float, depth: int) -> None:
        for frame, below in sorted(call.below.items(), key=lambda item: -item[1].samples):
            share = below.samples / root.samples
            if share >= LEAST and depth < DEPTH:
                _draw_frame(axes, frame, left, share, depth)
                add(below, left, depth + 1)
            left += share

    add(root, 0.0, 0)
    axes.set(xlim=(0.0, 1.0), ylim=(DEPTH, 0), yticks=[], xlabel="share of a tick in this process")
    figure.tight_layout()
    figure.savefig(output, dpi=110)


def _draw_frame(axes: Axes, frame: str, left: float, share: float, depth: int) -> None:
    colour = next((c for part, c in COLOURS.items() if f"({part}" in frame), "#d9d9d9")
    axes.add_patch(Rectangle((left, depth), share, 0.94, facecolor=colour, edgecolor="white"))
    if share >= NAMED:
        name = frame.partition(" (")[0].replace("<locals>.", "")
        room = int(share * 210)
        text = name if len(name) <= room else f"{name[: max(1, room - 1)]}…"
        axes.text(left + 0.002, depth + 0.5, text, fontsize=7, va="center", clip_on=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("samples", type=Path, help="py-spy's raw output")
    parser.add_argument("output", type=Path, help="picture, PNG or SVG")
    arguments = parser.parse_args()
    draw(tree_of(arguments.samples.read_text().splitlines()), arguments.output)


if __name__ == "__main__":
    main()
