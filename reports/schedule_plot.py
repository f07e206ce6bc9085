"""The schedule of a world, drawn before anything has moved: tasks and events over time."""

from __future__ import annotations

from typing import NamedTuple

from matplotlib.axes import Axes

from mrta_falsify.core.world import Blockage, World
from reports.colours import INK, UNSAFE
from reports.floor_plot import write_text

OUTAGE = "#7a3fc0"
TASK = "#4a6fa5"
OVERHANG = 1.02  # the time axis goes on so far beyond its end


class Bar(NamedTuple):
    """One row of the schedule."""

    start: float  #: [s]
    end: float  #: [s]
    colour: str
    text: str


def counts_text(world: World) -> str:
    """How many robots, people, tasks and events a world has, as text."""
    parts = [(len(world.robots), "robot"), (len(world.humans), "person")]
    parts += [(len(world.tasks), "task"), (len(world.events), "event")]
    plural = {"person": "people"}
    return ", ".join(
        f"{n} {name if n == 1 else plural.get(name, name + 's')}" for n, name in parts if n
    )


def schedule_rows(world: World) -> int:
    """Rows that the schedule of a world takes."""
    return len(world.tasks) + len(world.events)


def last_time(world: World) -> float:
    """End of what a schedule shows [s]; events that never end do not count."""
    times = [task.deadline for task in world.tasks]
    times += [t for event in world.events for t in (event.start, event.end) if t <= world.horizon]
    return max(times, default=world.horizon)


def draw_schedule(axes: Axes, world: World, end: float, *, rows: int, size: float) -> None:
    """Draw events, then tasks from arrival to deadline, one a row, in order of time.

    Args:
        axes: to draw in; loses its frame.
        world: whose schedule.
        end: of the time axis [s].
        rows: that the axes have room for.
        size: of the text [pt].
    """
    axes.set_xlim(0.0, end * OVERHANG)
    axes.set_ylim(rows - 0.3, -0.8)
    axes.set_yticks([])
    axes.set_xticks([])
    axes.patch.set_alpha(0.0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for row, bar in enumerate(_bars(world, end)):
        _draw_bar(axes, row, bar, size)


def _bars(world: World, end: float) -> list[Bar]:
    events = [
        Bar(
            event.start,
            min(event.end, end * OVERHANG),
            UNSAFE if isinstance(event, Blockage) else OUTAGE,
            event.name,
        )
        for event in sorted(world.events, key=lambda event: (event.start, event.name))
    ]
    tasks = [
        Bar(task.arrival, task.deadline, TASK, f"{task.start} to {task.end}")
        for task in sorted(world.tasks, key=lambda task: (task.arrival, task.deadline))
    ]
    return [*events, *tasks]


def _draw_bar(axes: Axes, row: int, bar: Bar, size: float) -> None:
    width = bar.end - bar.start
    axes.barh(row, width, left=bar.start, height=0.62, color=bar.colour, alpha=0.30, linewidth=0)
    axes.plot([bar.start, bar.start], [row - 0.36, row + 0.36], color=bar.colour, linewidth=1.1)
    write_text(
        axes, bar.start, row + 0.03, f"  {bar.text}", size=size, color=INK, va="center_baseline",
        clip_on=True,
    )  # fmt: skip
