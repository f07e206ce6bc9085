"""Small drawings as inline SVG: text is escaped, colours are the page's CSS variables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from markupsafe import Markup

from mrta_falsify.core.arrays import Array


class Drawing:
    """An SVG that is built element by element; y points down, units are pixels."""

    def __init__(
        self,
        width: float,
        height: float,
        *,
        label: str,
        data: dict[str, float] | None = None,
        name: str = "",
    ) -> None:
        self._name = name  # in the page, where another part shows it, too
        self._size = (width, height)
        self._label = label
        self._data = data or {}  # for the page's script, as data-NAME
        self._parts: list[str] = []

    def add(self, tag: str, text: str = "", /, **attributes: object) -> None:
        """Add one element; ``class_`` becomes ``class``, ``stroke_width`` ``stroke-width``."""
        pairs = " ".join(
            f"{name.rstrip('_').replace('_', '-')}={quoteattr(_shown(value))}"
            for name, value in attributes.items()
        )
        body = f">{escape(text)}</{tag}>" if text else "/>"
        self._parts.append(f"<{tag} {pairs}{body}")

    def line(self, points: Iterable[Sequence[float]] | Array, **attributes: object) -> None:
        """Add a polyline through ``points``."""
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.add("polyline", points=text, fill="none", **attributes)

    def polygon(self, points: Iterable[Sequence[float]] | Array, **attributes: object) -> None:
        """Add a closed outline through ``points``."""
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.add("polygon", points=text, **attributes)

    def polygons(self, outlines: Iterable[Array], **attributes: object) -> None:
        """Add closed outlines as one element, filled once where they overlap."""
        path = "".join(
            "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in outline) + "Z" for outline in outlines
        )
        if path:
            self.add("path", d=path, **attributes)

    def dots(self, points: Array, *, radius: float, **attributes: object) -> None:
        """Add filled circles as one element; those on one pixel are one."""
        places = np.unique(np.round(np.asarray(points).reshape(-1, 2)).astype(int), axis=0)
        if len(places):
            path = "".join(f"M{x} {y}h0" for x, y in places.tolist())
            self.add("path", d=path, fill="none", stroke_linecap="round",
                     stroke_width=2.0 * radius, **attributes)  # fmt: skip

    def crosses(self, points: Array, *, radius: float, **attributes: object) -> None:
        """Add crosses as one element, to be told from dots without colour; one for a pixel."""
        places = np.unique(np.round(np.asarray(points).reshape(-1, 2)).astype(int), axis=0)
        if len(places):
            r = radius
            path = "".join(
                f"M{x - r:g} {y - r:g}l{2 * r:g} {2 * r:g}m0 {-2 * r:g}l{-2 * r:g} {2 * r:g}"
                for x, y in places.tolist()
            )
            self.add("path", d=path, fill="none", stroke_width=1.6, **attributes)

    def arrow(self, start: Array, end: Array, **attributes: object) -> None:
        """Add a straight arrow with a head of 9 px."""
        way = np.asarray(end, dtype=float) - np.asarray(start, dtype=float)
        length = float(np.hypot(*way))
        if length < 1.0:
            return
        unit = way / length
        side = np.array([-unit[1], unit[0]])
        base = np.asarray(end) - 9.0 * unit
        self.line(np.stack([np.asarray(start), base]), **attributes)
        colour = attributes.get("stroke", "currentColor")
        head = np.stack([np.asarray(end), base + 4.5 * side, base - 4.5 * side])
        self.polygon(head, fill=colour)

    def markup(self) -> Markup:
        """Return the finished element."""
        width, height = self._size
        body = "".join(self._parts)
        # every text and attribute in it has been escaped above
        data = "".join(f' data-{name}="{value:g}"' for name, value in self._data.items())
        name = f" id={quoteattr(self._name)}" if self._name else ""
        return Markup(
            f'<svg{name} viewBox="0 0 {width:g} {height:g}" width="{width:g}"{data} role="img" '
            f"aria-label={quoteattr(self._label)}>"
            f"<title>{escape(self._label)}</title>{body}</svg>"
        )


def _shown(value: object) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


class FloorProjection:
    """Maps metres of a rectangle of the floor to pixels, north up."""

    def __init__(self, bounds: Sequence[float] | Array, width: float) -> None:
        x_min, y_min, x_max, y_max = (float(value) for value in bounds)
        self.scale = width / (x_max - x_min)
        self.width = width
        self.height = self.scale * (y_max - y_min)
        self._x, self._y = x_min, y_max
        self._bounds = np.array([x_min, y_min, x_max, y_max])

    def __call__(self, points: Array) -> Array:
        """Pixels ``(..., 2)`` of map points ``(..., 2)`` [m]."""
        points = np.asarray(points, dtype=np.float64)
        return np.stack(
            [(points[..., 0] - self._x) * self.scale, (self._y - points[..., 1]) * self.scale], -1
        )

    def shows(self, points: Array) -> bool:
        """Whether the rectangle around map points ``(..., 2)`` [m] reaches into the picture."""
        flat = np.asarray(points).reshape(-1, 2)
        low, high = flat.min(axis=0), flat.max(axis=0)
        return bool((high >= self._bounds[:2]).all() and (low <= self._bounds[2:]).all())


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round numbers between ``low`` and ``high``."""
    span = max(high - low, 1e-9)
    step = 10.0 ** np.floor(np.log10(span / count))
    for factor in (1.0, 2.0, 5.0, 10.0):
        if span / (step * factor) <= count:
            step *= factor
            break
    first = np.ceil(low / step) * step
    # adding 0 turns -0 into 0
    return [float(value) + 0.0 for value in np.arange(first, high + 1e-9 * span, step)]
