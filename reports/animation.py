"""An animated run, as GIF or MP4: the floor is drawn once, what moves is drawn per frame."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import imageio.v3 as iio
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageColor, ImageDraw, ImageFont

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.durable import naming, replacing, write_atomically
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.exporting import Exported
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.registry import WithoutOptions
from mrta_falsify.specs.books import confirmed
from reports.colours import INK, PAINTS, PHASES, UNSAFE, robot_colour
from reports.contents import RunView
from reports.floor_plot import draw_floor
from reports.floor_scene import (
    Extent,
    Role,
    Shape,
    extent_of,
    fixed_outlines,
    moving_scene,
    outline_of,
)

HEIGHT = 900  # pixels of the taller side
LEAST_WIDTH = 320  # pixels; the banner fits
FRAMES_PER_SECOND = 12
SPEED_UP = 10.0  # simulated seconds per second shown
MAX_FRAMES = 900  # longer runs are sped up further
TRAIL = 12.0  # s of way shown behind a robot
ENLARGED = 1.2  # robots are drawn so many times as large as they are
BANNER = 26  # pixels
QUEUEING = PHASES[Phase.QUEUEING].light
UNUSED = 255  # palette index that no colour has
FLOOR_COLOURS = 160  # of the palette, the others are for what moves


@dataclass(frozen=True, slots=True)
class FrameFloor:
    """The floor as pixels, and how to get there from the map frame."""

    image: Image.Image
    extent: Extent
    scale: float  #: pixels per metre

    def pixels(self, points: Array) -> list[tuple[float, float]]:
        """Pixel coordinates of map points ``(K, 2)`` [m]."""
        x = (points[:, 0] - self.extent.x_min) * self.scale
        y = (self.extent.y_max - points[:, 1]) * self.scale + BANNER
        return list(zip(x.tolist(), y.tolist(), strict=True))


def write_gif(view: RunView, path: Path) -> None:
    """Write the run as an animated GIF that repeats.

    Raises:
        ConfigError: the trace was not kept, so there is nothing to show.
    """
    palette = _palette(view)
    shown: list[Image.Image] = []
    before = None
    for frame in _frames(view):
        image = Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        pixels = np.asarray(image)
        # What did not change is left transparent: a tenth of the size.
        changed = pixels if before is None else np.where(pixels == before, UNUSED, pixels)
        before = pixels
        shown.append(Image.fromarray(changed.astype(np.uint8), mode="P"))
        shown[-1].putpalette(palette.getpalette() or [])
    with replacing(path) as file:
        shown[0].save(
            file,
            format="GIF",
            save_all=True,
            append_images=shown[1:],
            duration=round(1000 / FRAMES_PER_SECOND),
            loop=0,
            optimize=False,
            disposal=1,
            transparency=UNUSED,
        )


def write_mp4(view: RunView, path: Path) -> None:
    """Write the run as an MP4 video (H.264).

    Raises:
        ConfigError: the trace was not kept, or the `video` extra is not installed.
    """
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ConfigError(
            f"{path.name}: MP4 needs the extra `video`; use --gif, or run: "
            "pip install 'mrta-falsify[video]'"
        )
    frames = np.stack(list(_frames(view)))
    with naming(tempfile.gettempdir()):
        video = iio.imwrite(
            "<bytes>",
            frames,
            extension=".mp4",
            fps=FRAMES_PER_SECOND,
            codec="libx264",
            macro_block_size=2,
        )
    write_atomically(path, video)


def _palette(view: RunView) -> Image.Image:
    """Build one palette for all frames: the floor's colours and those of what moves."""
    floor = _draw_floor(view).image.quantize(colors=FLOOR_COLOURS, dither=Image.Dither.NONE)
    colours = (floor.getpalette() or [])[: 3 * FLOOR_COLOURS]
    robots = {robot_colour(number) for number in range(len(view.world.robots))}
    moving = (Role.PERSON, Role.BLIND_PERSON, Role.FURNITURE)
    painted = [colour for role in moving for colour in (PAINTS[role].fill, PAINTS[role].edge)]
    for name in (*sorted(robots), *painted, INK, UNSAFE, QUEUEING, "#ffffff"):
        colours += ImageColor.getrgb(name)[:3]
    image = Image.new("P", (1, 1))
    image.putpalette(colours)
    return image


def _frames(view: RunView) -> Iterator[np.ndarray]:
    """Draw RGB frames ``(rows, cols, 3)`` uint8, rows and cols even."""
    view = replace(view, trace=confirmed(view.trace, view.world))  # only these count as done
    trace = view.trace
    if "pose" not in trace.columns or len(trace) == 0:
        raise ConfigError("an animation needs the trace, but this run did not keep it")
    step = max(SPEED_UP / FRAMES_PER_SECOND, trace.duration / MAX_FRAMES)
    stride = max(1, round(step / trace.dt))
    speed = stride * trace.dt * FRAMES_PER_SECOND
    floor = _draw_floor(view)
    ticks = [*range(0, len(trace), stride)]
    if ticks[-1] != len(trace) - 1:
        ticks.append(len(trace) - 1)
    for tick in ticks:
        yield _draw_frame(floor, view, tick, speed)


def _draw_floor(view: RunView) -> FrameFloor:
    extent = extent_of(view.world)
    scale = (HEIGHT - BANNER) / max(extent.width, extent.height)
    width, height = (2 * round(scale * length / 2.0) for length in (extent.width, extent.height))
    width = max(width, LEAST_WIDTH)
    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    furniture = fixed_outlines(view.world)
    draw_floor(axes, view.world, view.costmap, label_size=6.5, furniture=furniture)
    axes.set_anchor("NW")
    axes.axis("off")
    canvas.draw()  # type: ignore[no-untyped-call]
    floor = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])  # type: ignore[no-untyped-call]
    image = Image.new("RGB", (width, height + BANNER), "white")
    image.paste(floor, (0, BANNER))
    return FrameFloor(image=image, extent=extent, scale=height / extent.height)


def _draw_frame(floor: FrameFloor, view: RunView, tick: int, speed: float) -> np.ndarray:
    image = floor.image.copy()
    draw = ImageDraw.Draw(image)
    for shape in moving_scene(view.world, view.trace, tick, trail=TRAIL):
        _paint(draw, floor, shape)
        if shape.role is Role.ROBOT:
            _paint_state(draw, floor, view, tick, shape)
    _draw_banner(draw, view, tick, speed)
    return np.asarray(image)


def _paint(draw: ImageDraw.ImageDraw, floor: FrameFloor, shape: Shape) -> None:
    points = floor.pixels(shape.points)
    if shape.role is Role.FURNITURE:
        paint = PAINTS[shape.role]
        draw.polygon(points, fill=paint.fill, outline=paint.edge)
    elif shape.role is Role.TRAIL and len(points) > 1:
        draw.line(points, fill=robot_colour(shape.number), width=2)
    elif shape.role in (Role.PERSON, Role.BLIND_PERSON):
        paint = PAINTS[shape.role]
        box = _box_around(points[0], max(3.0, shape.radius * floor.scale))
        draw.ellipse(box, fill=paint.fill, outline=paint.edge)
    elif shape.role is Role.ROBOT:
        outline = floor.pixels(outline_of(shape, scale=ENLARGED))
        draw.polygon(outline, fill=robot_colour(shape.number), outline="white")


def _paint_state(
    draw: ImageDraw.ImageDraw, floor: FrameFloor, view: RunView, tick: int, robot: Shape
) -> None:
    """Paint a ring around a robot: yellow while it queues, red while it touches something."""
    columns = view.trace.columns
    (place,) = floor.pixels(robot.points)
    if columns["contact"][tick, robot.number].any():
        draw.ellipse(_box_around(place, 13.0), outline=UNSAFE, width=3)
    elif columns["phase"][tick, robot.number] == Phase.QUEUEING:
        draw.ellipse(_box_around(place, 11.0), outline=QUEUEING, width=2)


def _box_around(place: tuple[float, float], reach: float) -> tuple[float, float, float, float]:
    x, y = place
    return x - reach, y - reach, x + reach, y + reach


def _draw_banner(draw: ImageDraw.ImageDraw, view: RunView, tick: int, speed: float) -> None:
    trace = view.trace
    now = float(trace.columns["time"][tick])
    done = sum(event.kind == "dropped-off" and event.time <= now for event in trace.events)
    text = f"{now:6.1f} s   {done}/{len(view.world.tasks)} tasks   {speed:.0f}x"
    draw.rectangle((0, 0, draw.im.size[0], BANNER), fill=INK)
    font = cast(ImageFont.FreeTypeFont, ImageFont.load_default(size=15))
    draw.text((8, 4), text, fill="white", font=font)


# --- as formats of `export` -------------------------------------------------------------------


class Gif(WithoutOptions):
    """An animated run that repeats."""

    of_run, of_folder = True, False
    _write = staticmethod(write_gif)

    def write(self, exported: Exported, path: Path) -> tuple[Path, ...]:
        """See :class:`~mrta_falsify.core.exporting.Exporter`."""
        view = RunView(
            world=exported.world,
            trace=exported.run(),
            verdicts=exported.verdicts,
            costmap=exported.picture_map(),
        )
        self._write(view, path)
        return (path,)


class Mp4(Gif):
    """A video of a run."""

    _write = staticmethod(write_mp4)
