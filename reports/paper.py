"""Figures laid out in inches, saved so that equal runs give equal files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mrta_falsify.core.durable import replacing
from reports.colours import INK

DPI = 100
MARGIN = 0.55  # inches around a map


@dataclass(frozen=True, slots=True, eq=False)
class Paper:
    """A white figure whose parts are placed in inches from its lower left corner."""

    figure: Figure
    width: float
    height: float

    @classmethod
    def of_size(cls, width: float, height: float) -> Paper:
        """Take a sheet of ``width`` times ``height`` [inches]."""
        figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
        FigureCanvasAgg(figure)
        return cls(figure, width, height)

    def axes_at(self, left: float, bottom: float, width: float, height: float) -> Axes:
        """Add axes of a size [inches]."""
        box = (left / self.width, bottom / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(box)

    def write(
        self,
        left: float,
        bottom: float,
        text: str,
        *,
        size: float,
        colour: str = INK,
        weight: str = "normal",
        ha: str = "left",
    ) -> None:
        """Write a line of text [inches, pt]; it is never read as a formula."""
        self.figure.text(
            left / self.width,
            bottom / self.height,
            text,
            size=size,
            color=colour,
            weight=weight,
            ha=ha,
            parse_math=False,
        )

    def save(self, path: Path) -> None:
        """Write the picture; the format follows the suffix (png, svg or pdf).

        Raises:
            PlaceError: it cannot be written.
        """
        # A date in the file would make two equal runs differ.
        metadata = {"Date": None} if path.suffix == ".svg" else {}
        with replacing(path) as file:
            self.figure.savefig(file, format=path.suffix[1:] or None, dpi=DPI, metadata=metadata)
