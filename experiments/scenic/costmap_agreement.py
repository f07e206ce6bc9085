"""Does the costmap show what stands in the Bullet world, cell by cell?

    python experiments/scenic/costmap_agreement.py [--worlds N] [--seed S] [--json FILE]

For each sampled world the Bullet engine builds its bodies, and rays at 0.2 m height run along
the centre line of every row and column of the costmap; each ray goes on behind what it hits,
so that all upright faces on the line are found. Blockages are made to stand from time 0 on.

Objects, one at a time: for each object that the program generated, rays in a Bullet world
that holds only this object give the cells between the first and last face of each line.
All of them, and all cells with a face, must be lethal in the costmap of the whole world.

The whole world: two neighbouring centres belong together if no face lies between them. In
what belongs together, either all cells are lethal (inside of something) or none is (free
floor); cells within 0.05 m of a face are not asked, as the closed cell counts there. A cell
with a face must be lethal.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.costmap import LETHAL, Costmap
from mrta_falsify.core.world import Blockage, Furniture, World
from mrta_falsify.commands.programs import draw_candidates, open_scenario
from scenic_worlds.program import Program
from scenic_worlds.shipped import scenario_names
from simulator_interface.costmap_layers import build_costmap
from simulator_interface.engines.bullet import RAY_HEIGHT, BulletEngine

ASIDE = 0.0031  # m, lines run beside the centres: a ray along an edge may slip past both faces
BEYOND = 1e-5  # m, behind a hit a ray goes on from here
MAX_FACES = 400  # on one line
BATCH = 8000  # rays in one query


@dataclass(slots=True)
class Agreement:
    """Counts over worlds."""

    worlds: int = 0
    objects: int = 0
    object_cells: int = 0  #: that Bullet says an object covers or touches
    object_cells_not_lethal: int = 0
    objects_unseen: int = 0  #: that no ray met
    face_cells: int = 0  #: with an upright face, of anything
    face_cells_not_lethal: int = 0
    free_cells: int = 0  #: compared, not lethal
    inner_cells: int = 0  #: compared, lethal
    mixed_areas: int = 0  #: without a face in between, yet partly lethal and partly not

    @property
    def disagreements(self) -> int:
        """Everything that must be 0."""
        return (
            self.object_cells_not_lethal
            + self.objects_unseen
            + self.face_cells_not_lethal
            + self.mixed_areas
        )


def standing(world: World) -> World:
    """The world's solids alone, with blockages that stand from the start on."""
    blockages = tuple(
        dataclasses.replace(event, start=0.0, end=1e9)
        for event in world.events
        if isinstance(event, Blockage)
    )
    return dataclasses.replace(world, robots=(), humans=(), tasks=(), events=blockages)


def generated(world: World, fixed: int) -> tuple[Furniture | Blockage, ...]:
    """What the program added to its layout, whose furniture comes first in the world."""
    return (*world.furniture[fixed:], *(e for e in world.events if isinstance(e, Blockage)))


def alone(world: World, item: Furniture | Blockage) -> World:
    """A world that holds one object only."""
    if isinstance(item, Blockage):
        return dataclasses.replace(world, walls=(), furniture=(), events=(item,))
    return dataclasses.replace(world, walls=(), furniture=(item,), events=())


# --- rays --------------------------------------------------------------------------------------


@dataclass(slots=True)
class Faces:
    """Upright faces on the centre lines of rows and columns."""

    along_rows: tuple[Array, Array]  #: row numbers and x [m]
    along_cols: tuple[Array, Array]  #: column numbers and y [m]


def find_faces(world: World, grid: Costmap) -> Faces:
    """Cast rays along every centre line of ``grid`` in the Bullet world of ``world``."""
    engine = BulletEngine(BulletEngine.Options())
    try:
        engine.start(world, 0.05, np.zeros((0, 2)))
        rows, cols = grid.cost.shape
        low = grid.origin - grid.resolution
        high = grid.origin + grid.resolution * (np.array([cols, rows]) + 1.0)
        ys = grid.origin[1] + (np.arange(rows) + 0.5) * grid.resolution + ASIDE
        xs = grid.origin[0] + (np.arange(cols) + 0.5) * grid.resolution + ASIDE
        return Faces(
            _hits(engine.client.number, ys, float(low[0]), float(high[0]), axis=0),
            _hits(engine.client.number, xs, float(low[1]), float(high[1]), axis=1),
        )
    finally:
        engine.close()


def _hits(client: int, lines: Array, low: float, high: float, *, axis: int) -> tuple[Array, Array]:
    """Line numbers and positions [m] along ``axis`` of all faces."""
    numbers = np.arange(len(lines))
    start = np.full(len(lines), low)
    found_lines, found_places = [], []
    for _ in range(MAX_FACES):
        if not len(numbers):
            return np.concatenate(found_lines), np.concatenate(found_places)
        begin = np.full((len(numbers), 3), RAY_HEIGHT)
        begin[:, axis], begin[:, 1 - axis] = start, lines[numbers]
        end = begin.copy()
        end[:, axis] = high
        hits = []
        for first in range(0, len(begin), BATCH):
            hits += pybullet.rayTestBatch(
                begin[first : first + BATCH].tolist(),
                end[first : first + BATCH].tolist(),
                physicsClientId=client,
            )
        met = np.array([hit[0] >= 0 for hit in hits])
        places = np.array([hit[3][axis] for hit in hits])[met]
        numbers = numbers[met]
        found_lines.append(numbers)
        found_places.append(places)
        start = places + BEYOND
    raise AssertionError(f"more than {MAX_FACES} faces on one line")


# --- comparison ----------------------------------------------------------------------------------


def face_cells(faces: Faces, grid: Costmap) -> BoolArray:
    """Cells with a face on one of their centre lines; none outside the grid."""
    has_face = np.zeros(grid.cost.shape, dtype=np.bool_)
    rows, x = faces.along_rows
    cols, y = faces.along_cols
    col = np.floor((x - grid.origin[0]) / grid.resolution).astype(np.int64)
    row = np.floor((y - grid.origin[1]) / grid.resolution).astype(np.int64)
    inside = (col >= 0) & (col < grid.cost.shape[1])
    has_face[rows[inside], col[inside]] = True
    inside = (row >= 0) & (row < grid.cost.shape[0])
    has_face[row[inside], cols[inside]] = True
    return has_face


def covered_cells(faces: Faces, grid: Costmap) -> BoolArray:
    """Cells whose centre lies between the first and last face of its row (a convex object)."""
    covered = np.zeros(grid.cost.shape, dtype=np.bool_)
    x = grid.origin[0] + (np.arange(grid.cost.shape[1]) + 0.5) * grid.resolution + ASIDE
    rows, places = faces.along_rows
    for row in np.unique(rows):
        line = places[rows == row]
        covered[row] = (x >= line.min()) & (x <= line.max())
    return covered


def areas(faces: Faces, grid: Costmap) -> Array:
    """Number per cell; two cells have the same if a way without faces joins their centres."""
    rows, cols = grid.cost.shape
    number = np.arange(rows * cols).reshape(rows, cols)
    right = np.ones((rows, cols - 1), dtype=np.bool_)  # open between (row, col) and (row, col + 1)
    up = np.ones((rows - 1, cols), dtype=np.bool_)
    line, x = faces.along_rows
    before = np.floor((x - ASIDE - grid.origin[0]) / grid.resolution - 0.5).astype(np.int64)
    inside = (before >= 0) & (before < cols - 1)
    right[line[inside], before[inside]] = False
    line, y = faces.along_cols
    before = np.floor((y - ASIDE - grid.origin[1]) / grid.resolution - 0.5).astype(np.int64)
    inside = (before >= 0) & (before < rows - 1)
    up[before[inside], line[inside]] = False
    a = np.concatenate([number[:, :-1][right], number[:-1][up]])
    b = np.concatenate([number[:, 1:][right], number[1:][up]])
    graph = sparse.coo_matrix((np.ones(len(a), dtype=np.bool_), (a, b)), (rows * cols,) * 2)
    return csgraph.connected_components(graph, directed=False)[1].reshape(rows, cols)


def compare(world: World, fixed: int, total: Agreement) -> None:
    """Add one world to the counts; says on stderr where it disagrees."""
    solids = standing(world)
    grid = build_costmap(solids)
    lethal = grid.cost == LETHAL
    total.worlds += 1
    for item in generated(solids, fixed):
        faces = find_faces(alone(solids, item), grid)
        cells = face_cells(faces, grid) | covered_cells(faces, grid)
        total.objects += 1
        total.objects_unseen += not cells.any()
        total.object_cells += int(cells.sum())
        missed = int((cells & ~lethal).sum())
        total.object_cells_not_lethal += missed
        if missed or not cells.any():
            print(f"{world.name} seed {world.seed}, {item.name}: {missed} cells", file=sys.stderr)
    faces = find_faces(solids, grid)
    touched = face_cells(faces, grid)
    total.face_cells += int(touched.sum())
    total.face_cells_not_lethal += int((touched & ~lethal).sum())
    area = areas(faces, grid)
    asked = ~ndimage.binary_dilation(touched, np.ones((3, 3), dtype=np.bool_))
    count = int(area.max()) + 1
    some_lethal = np.bincount(area[asked], lethal[asked], count) > 0
    some_free = np.bincount(area[asked], ~lethal[asked], count) > 0
    mixed = int((some_lethal & some_free).sum())
    total.mixed_areas += mixed
    total.free_cells += int((asked & ~lethal).sum())
    total.inner_cells += int((asked & lethal).sum())
    if mixed:
        print(f"{world.name} seed {world.seed}: {mixed} mixed areas", file=sys.stderr)


def fixed_furniture(program: Program) -> int:
    """How many pieces of furniture come with the layout; the layout may be random."""
    places = program.scenario.params["_places"]
    layout = getattr(places, "layout", None)
    return len(layout.furniture) if isinstance(layout, World) else 0


def run(names: Sequence[str], worlds: int, seed: int) -> dict[str, Agreement]:
    """Counts per program over ``worlds`` candidates each."""
    results = {}
    for name in names:
        program = open_scenario(name)
        fixed = fixed_furniture(program)
        total = results.setdefault(program.name, Agreement())
        for drawn in draw_candidates(program, count=worlds, seed=seed):
            if drawn.world is not None:
                compare(drawn.world, fixed, total)
    return results


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("programs", nargs="*", help="all shipped ones if none is named")
    parser.add_argument("--worlds", type=int, default=16, help="of each program")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    names = args.programs or scenario_names()
    total = Agreement()
    print(
        f"{'program':24}{'worlds':>8}{'objects':>9}{'cells':>9}{'missed':>8}{'faces':>10}"
        f"{'missed':>8}{'free cells':>12}{'mixed':>7}{'s':>7}"
    )
    data = {}
    for name in names:
        began = time.process_time()
        for program, one in run([name], args.worlds, args.seed).items():
            print(
                f"{program:24}{one.worlds:8}{one.objects:9}{one.object_cells:9}"
                f"{one.object_cells_not_lethal + one.objects_unseen:8}{one.face_cells:10}"
                f"{one.face_cells_not_lethal:8}{one.free_cells:12}{one.mixed_areas:7}"
                f"{time.process_time() - began:7.1f}",
                flush=True,
            )
            data[program] = dataclasses.asdict(one)
            for field in dataclasses.fields(Agreement):
                value = getattr(total, field.name) + getattr(one, field.name)
                setattr(total, field.name, value)
    print(f"total: {dataclasses.asdict(total)}; disagreements: {total.disagreements}")
    if args.json:
        result = {"seed": args.seed, "total": dataclasses.asdict(total), "programs": data}
        args.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 1 if total.disagreements else 0


if __name__ == "__main__":
    sys.exit(main())
