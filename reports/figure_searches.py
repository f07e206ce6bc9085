"""How long searches went on without a failure, drawn as survival curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.durable import replacing
from reports.colours import INK, robot_colour

#: times (n,) from 0 on, increasing, and the share (n,) of searches without a failure from each on
Curve = tuple[Array, Array]
COLUMNS = 3


def write_searches(panels: Mapping[str, Mapping[str, Curve]], budget: int, path: Path) -> None:
    """Write survival curves as a picture, a panel for each scenario.

    Args:
        panels: by scenario, then by sampler.
        budget: simulations per search; where the axis ends.
        path: of the PNG.
    """
    columns = min(COLUMNS, max(len(panels), 1))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(3.6 * columns + 0.4, 2.9 * rows), layout="constrained", dpi=130)
    all_axes = figure.subplots(rows, columns, squeeze=False).ravel()
    names = list(dict.fromkeys(name for curves in panels.values() for name in curves))
    for axes, (title, curves) in zip(all_axes, panels.items(), strict=False):
        draw_searches(axes, curves, budget, names)
        axes.set_title(title, fontsize=9, color=INK, loc="left")
    for axes in all_axes[len(panels) :]:
        axes.set_visible(False)
    # One legend for all panels: inside of one it would lie upon curves.
    lines = {line.get_label(): line for axes in all_axes for line in axes.get_lines()}
    figure.legend(
        handles=[lines[name] for name in names],
        fontsize=8,
        frameon=False,
        loc="outside upper left",
        ncols=2 * columns,
    )
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:] or None)


def draw_searches(
    axes: Axes, curves: Mapping[str, Curve], budget: int, names: Sequence[str]
) -> None:
    """Survival curves by sampler; the place in ``names`` decides a sampler's colour."""
    for name, (times, share) in curves.items():
        axes.step(
            np.append(times, budget),
            np.append(share, share[-1]),
            where="post",
            label=name,
            color=robot_colour(names.index(name)),
            linewidth=1.6,
        )
    axes.set_xlim(0, budget)
    axes.set_ylim(-0.02, 1.02)
    axes.set_xlabel("simulations", fontsize=8)
    axes.set_ylabel("searches without a failure", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
