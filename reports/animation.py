"""An animated run, as GIF or MP4: the floor is drawn once, what moves is drawn per frame."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import imageio.v3 as iio
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageColor, ImageDraw, ImageFont

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.trace import Trace
from reports.colours import FURNITURE, FURNITURE_EDGE, HUMAN, HUMAN_BLIND, INK, UNSAFE, robot_colour
from reports.figure_floor import draw_floor
from reports.figure_motion import robot_outline
from reports.furnishing import fixed_outlines, movable_outlines
from reports.run_view import RunView, extent_of

HEIGHT = 900  # pixels of the taller side
FRAMES_PER_SECOND = 12
SPEED_UP = 10.0  # simulated seconds per second shown
MAX_FRAMES = 900  # longer runs are sped up further
TAIL = 12.0  # s of way shown behind a robot
BANNER = 26  # pixels
QUEUEING = "#d99a00"
UNUSED = 255  # palette index that no colour has


@dataclass(frozen=True, slots=True)
class _Canvas:
    """The floor as pixels, and how to get there from the map frame."""

    image: Image.Image
    extent: tuple[float, float, float, float]
    scale: float  #: pixels per metre

    def pixels(self, points: Array) -> list[tuple[float, float]]:
        """Pixel coordinates of map points ``(K, 2)`` [m]."""
        x = (points[:, 0] - self.extent[0]) * self.scale
        y = (self.extent[3] - points[:, 1]) * self.scale + BANNER
        return list(zip(x.tolist(), y.tolist(), strict=True))


def write_gif(view: RunView, path: Path) -> None:
    """Write the run as an animated GIF that plays for ever.

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
    shown[0].save(
        path,
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
            f"{path}: MP4 needs the extra `video`; use --gif, or run: "
            "pip install 'mrta-falsify[video]'"
        )
    frames = np.stack(list(_frames(view)))
    iio.imwrite(
        path, frames, extension=".mp4", fps=FRAMES_PER_SECOND, codec="libx264", macro_block_size=2
    )


def _palette(view: RunView) -> Image.Image:
    """One palette for all frames: the floor's colours and those of everything that moves."""
    floor = _draw_canvas(view).image.quantize(colors=160, dither=Image.Dither.NONE)
    colours = (floor.getpalette() or [])[: 3 * 160]
    robots = {robot_colour(number) for number in range(len(view.world.robots))}
    for name in (
        *sorted(robots),
        HUMAN,
        HUMAN_BLIND,
        INK,
        UNSAFE,
        QUEUEING,
        FURNITURE,
        FURNITURE_EDGE,
        "#ffffff",
    ):
        colours += ImageColor.getrgb(name)[:3]
    image = Image.new("P", (1, 1))
    image.putpalette(colours)
    return image


def _frames(view: RunView) -> Iterator[np.ndarray]:
    """RGB frames ``(rows, cols, 3)`` uint8, rows and cols even."""
    trace = view.trace
    if "pose" not in trace.columns or len(trace) == 0:
        raise ConfigError("an animation needs the trace, but this run did not keep it")
    step = max(SPEED_UP / FRAMES_PER_SECOND, trace.duration / MAX_FRAMES)
    stride = max(1, round(step / trace.dt))
    speed = stride * trace.dt * FRAMES_PER_SECOND
    canvas = _draw_canvas(view)
    ticks = [*range(0, len(trace), stride)]
    if ticks[-1] != len(trace) - 1:
        ticks.append(len(trace) - 1)
    for tick in ticks:
        yield _draw_frame(canvas, view, tick, speed)


def _draw_canvas(view: RunView) -> _Canvas:
    extent = extent_of(view.world)
    size = np.array([extent[2] - extent[0], extent[3] - extent[1]])
    scale = (HEIGHT - BANNER) / float(size.max())
    width, height = (2 * round(scale * length / 2.0) for length in size.tolist())
    width = max(width, 320)
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
    return _Canvas(image=image, extent=extent, scale=height / float(size[1]))


def _draw_frame(canvas: _Canvas, view: RunView, tick: int, speed: float) -> np.ndarray:
    trace = view.trace
    image = canvas.image.copy()
    draw = ImageDraw.Draw(image)
    for outline in movable_outlines(view.world, trace, tick):
        draw.polygon(canvas.pixels(outline), fill=FURNITURE, outline=FURNITURE_EDGE)
    _draw_people(draw, canvas, view, tick)
    first = max(0, tick - round(TAIL / trace.dt))
    for number, robot in enumerate(view.world.robots):
        colour = robot_colour(number)
        tail = trace.columns["pose"][first : tick + 1 : 4, number, :2]
        if len(tail) > 1:
            draw.line(canvas.pixels(tail), fill=colour, width=2)
        outline = robot_outline(trace.columns["pose"][tick, number], robot.radius * 1.2)
        draw.polygon(canvas.pixels(outline), fill=colour, outline="white")
        _draw_state(draw, canvas, trace, tick, number)
    _draw_banner(draw, view, tick, speed)
    return np.asarray(image)


def _draw_people(draw: ImageDraw.ImageDraw, canvas: _Canvas, view: RunView, tick: int) -> None:
    positions = view.trace.columns["human_position"][tick]
    for human, position in zip(view.world.humans, positions, strict=True):
        if np.isnan(position).any():  # not in the building
            continue
        ((x, y),) = canvas.pixels(position[None])
        reach = max(3.0, human.radius * canvas.scale)
        colour = HUMAN if human.reacts_to_robots else HUMAN_BLIND
        draw.ellipse((x - reach, y - reach, x + reach, y + reach), fill=colour, outline="white")


def _draw_state(
    draw: ImageDraw.ImageDraw, canvas: _Canvas, trace: Trace, tick: int, number: int
) -> None:
    """Ring: yellow while queueing, red while a touch is seen."""
    ((x, y),) = canvas.pixels(trace.columns["pose"][tick, number : number + 1, :2])
    if trace.columns["contact"][tick, number].any():
        draw.ellipse((x - 13, y - 13, x + 13, y + 13), outline=UNSAFE, width=3)
    elif trace.columns["phase"][tick, number] == Phase.QUEUEING:
        draw.ellipse((x - 11, y - 11, x + 11, y + 11), outline=QUEUEING, width=2)


def _draw_banner(draw: ImageDraw.ImageDraw, view: RunView, tick: int, speed: float) -> None:
    trace = view.trace
    now = float(trace.columns["time"][tick])
    done = sum(event.kind == "dropped-off" and event.time <= now for event in trace.events)
    text = f"{now:6.1f} s   {done}/{len(view.world.tasks)} tasks   {speed:.0f}x"
    draw.rectangle((0, 0, draw.im.size[0], BANNER), fill=INK)
    font = cast(ImageFont.FreeTypeFont, ImageFont.load_default(size=15))
    draw.text((8, 4), text, fill="white", font=font)
