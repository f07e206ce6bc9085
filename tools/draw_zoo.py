"""The zoo's page: a picture of each scene, and which stack survives which.

    python -m tools.draw_zoo [--stacks FILE.yaml ...] [--only STACK ...]

Writes docs/pictures/zoo/NAME.png, and the part of docs/zoo.md between its two markers. The stacks
are the default one, each alternative layer in it, and those of the files. Each row is put down as
soon as it is measured; other rows of the table stay as they are.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes

from mrta_falsify.commands.zoo import SceneCheck, run_zoo
from mrta_falsify.core import registry
from mrta_falsify.core.config import STACK_LAYERS, StackConfig
from mrta_falsify.core.world import World
from reports.colours import robot_colour
from reports.contact_sheet import draw_small_map
from reports.floor_scene import extent_of
from reports.paper import Paper
from scenic_worlds.zoo import Scene, load_scene, scene_names

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "zoo.md"
PICTURES = DOCS / "pictures" / "zoo"
BEGIN, END = "<!-- measured by tools.draw_zoo: begin -->", "<!-- end -->"
SCALE = 0.34  # inches per metre
AREA = "#e07000"
LIMIT = 900.0  # s of wall clock for one run, so that a busy machine changes nothing
NO_MATTER = ("allocator",)  # layers that change nothing: each task names its robot
WORDS = {"passes": "passes", "fails": "**fails**", "flaky": "*flaky*"}
SHORT = {
    "no_deadlock": "deadlock",
    "no_livelock": "livelock",
    "exclusive_use": "shared",
    "all_tasks_done": "undone",
}


def draw_scene(world: World, path: Path) -> None:
    """Draw a scene at its start: floor, exclusive areas, who wants where."""
    extent = extent_of(world)
    paper = Paper.of_size(extent.width * SCALE, extent.height * SCALE)
    axes = paper.axes_at(0.0, 0.0, paper.width, paper.height)
    draw_small_map(axes, world, extent, frozenset())
    for resource in world.resources:
        if resource.capacity == 1:
            axes.fill(
                *resource.release_area.T,
                facecolor="none",
                edgecolor=AREA,
                ls="--",
                lw=0.9,
                zorder=4,
            )
    _draw_nominal(axes, world)
    paper.save(path)


def _draw_nominal(axes: Axes, world: World) -> None:
    """Draw an arrow from each robot to where its first delivery ends."""
    seen = set()
    for task in world.tasks:
        if task.robot in seen:
            continue
        seen.add(task.robot)
        number = next(i for i, robot in enumerate(world.robots) if robot.name == task.robot)
        colour = robot_colour(number)
        axes.annotate(
            "",
            world.rooms[task.end].point,
            world.robots[number].pose[:2],
            arrowprops={
                "arrowstyle": "->",
                "color": colour,
                "lw": 1.2,
                "shrinkB": 8,
                "connectionstyle": "arc3,rad=0.12",
            },
            zorder=30,
        )


def stacks(files: Sequence[str]) -> list[tuple[str, str | None, tuple[str, ...]]]:
    """List the stacks: name, file and settings."""
    found: list[tuple[str, str | None, tuple[str, ...]]] = [("default", None, ())]
    default = StackConfig()
    for layer in STACK_LAYERS:
        for name in registry.names(layer):
            if layer not in NO_MATTER and name != getattr(default, layer).name:
                found.append((f"{layer}={name}", None, (f"{layer}={name}",)))
    brake = "controller.followers=brake"
    found.append((brake, None, (brake,)))
    return found + [(Path(file).parent.name, file, ()) for file in files]


def cell(row: SceneCheck) -> str:
    """Say in a word or two what a stack did."""
    word = WORDS.get(row.fate, row.fate)
    if row.fate not in ("fails", "flaky"):
        return word
    kinds = [SHORT.get(name, name.removeprefix("no_").replace("_", " ")) for name in row.violated]
    return f"{word}: {', '.join(kinds[:1] or ['?'])}"


def table_row(
    scenes: Sequence[Scene], name: str, file: str | None, settings: tuple[str, ...]
) -> str:
    """Run a stack in the folder of its file, and write its row."""
    path = Path(file).resolve() if file else None
    with contextlib.chdir(path.parent if path else DOCS):
        ran = run_zoo(stack=path and str(path), settings=settings, time_limit=LIMIT)
    rows = {row.name: row for row in ran}
    right = sum(row.is_as_known for row in ran)
    cells = " | ".join(cell(rows[scene.name]) for scene in scenes)
    return f"| `{name}` | {right} of {len(scenes)} | {cells} |"


def put_row(row: str, scenes: int) -> None:
    """Put a row in place of the one that the page has, or at the end."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    old, _, after = rest.partition(END)
    rows = {line.split("`")[1]: line for line in old.splitlines() if line.startswith("| `")}
    rows[row.split("`")[1]] = row
    numbers = " | ".join(f"({i + 1})" for i in range(scenes))
    lines = [f"| Stack | as known | {numbers} |", "|---" * (scenes + 2) + "|", *rows.values()]
    whole = "\n".join(lines)
    PAGE.write_text(f"{before}{BEGIN}\n\n{whole}\n\n{END}{after}", encoding="utf-8")


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stacks", nargs="*", default=[], help="YAML files of other stacks")
    parser.add_argument("--only", nargs="*", default=[], help="stacks to run; all if none")
    arguments = parser.parse_args()
    scenes = [load_scene(name) for name in scene_names()]
    PICTURES.mkdir(parents=True, exist_ok=True)
    for scene in scenes:
        draw_scene(scene.world, PICTURES / f"{scene.name}.png")
    for name, file, settings in stacks(arguments.stacks):
        if not arguments.only or name in arguments.only:
            print(f"{name} ...", file=sys.stderr, flush=True)
            put_row(table_row(scenes, name, file, settings), len(scenes))
    return 0


if __name__ == "__main__":
    sys.exit(main())
