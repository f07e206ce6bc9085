"""Programs for Scenic's specifiers of position and orientation, and draws from both sides.

In each program what stands at random is called ``a``, and what it stands relative to ``b``. The
regions are narrow, so that containers prune.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scenic.syntax import translator
from scipy.spatial.distance import pdist, squareform

from mrta_falsify.core.arrays import Array
from scenic_worlds.primitives import randomness
from scenic_worlds.program import Mode, compile_program

HEAD = """
import math
from shapely.geometry import box
model scenic_worlds.model

class Thing(FloorObject):
    kind: 'furniture'
    width: 0.6
    length: 0.9
    regionContainedIn: everywhere
    allowCollisions: True

class Backed(Thing):
    baseOffset: (0, -self.length / 2, 0)

ego = new Robot with name 'robot1', with start_room 0
param tasks = [(0, 1, 2, 240)]
pen = RectangularRegion((4, -8), 0, 5, 7)
swirl = VectorField('swirl', lambda p: math.atan2(p[1] + 8, p[0] - 4) + 0.3 * p[0])
yard = PolygonalRegion([(0, -12), (8, -12), (8, -9), (5, -9), (5, -4), (0, -4)], orientation=swirl)
lane = PolylineRegion([(4, -14), (4, -6), (8, -6)])
tiles = PolygonalVectorField('tiles', [(box(0, -12, 4, -4), 0.5), (box(4, -12, 8, -4), -1.2)])
tiled = PolygonalRegion([(0, -12), (8, -12), (8, -4), (0, -4)], orientation=tiles)
"""
IN_PEN = "with name 'a', with regionContainedIn pen"

PROGRAMS = {
    "at": f"new Thing at (Range(0, 8), Range(-12, -4)), facing Range(0, 360) deg, {IN_PEN}",
    "in region": f"new Thing in yard, {IN_PEN}",
    "in line": f"new Thing in lane, {IN_PEN}",
    "contained in": "new Thing contained in yard, with name 'a'",
    "on region": f"new Thing on yard, {IN_PEN}",
    "on region, back edge": f"new Backed on yard, {IN_PEN}",
    "on region, facing": f"new Backed on yard, facing 90 deg relative to swirl, {IN_PEN}",
    "on region without orientation": f"new Backed on RectangularRegion((4, -8), 0, 9, 9), {IN_PEN}",
    "on region, random length": f"new Backed on yard, with length Range(0.5, 2), {IN_PEN}",
    "on line": f"new Backed on lane, {IN_PEN}",
    "on one of two regions": f"new Backed on Uniform(lane, yard), {IN_PEN}",
    "on route": "new Chair on route(0, 2), with name 'a'",
    "on along_wall": "new Cabinet on along_wall(2), with name 'a'",
    "on doorway": "new Stool on doorway(2), with name 'a', with regionContainedIn free_floor",
    "on intersection": f"new Backed on yard.intersect(CircularRegion((4, -9), 3)), {IN_PEN}",
    "on difference": f"new Backed on yard.difference(CircularRegion((4, -9), 2)), {IN_PEN}",
    "in tiles, relative heading": f"""
b = new Thing in tiled, facing tiles, with name 'b', with regionContainedIn pen
a = new Thing in tiled, facing tiles, {IN_PEN}
require abs(relative heading of a from b) < 0.4
require (distance from a to b) < 3""",
    "on object": """
b = new Thing in yard, with name 'b', with width 2, with length 3
new Thing on b, with name 'a'""",
    "on mesh": "new Thing on SpheroidRegion(dimensions=(4, 4, 4)).getSurfaceRegion(), "
    "with name 'a'",
    "in mesh": "new Thing in SpheroidRegion(dimensions=(6, 6, 6), position=(4, -8, 0)), "
    "with name 'a'",
    "on, projecting": "new Thing in yard, on BoxRegion(dimensions=(5, 7, 1), "
    "position=(4, -8, 0)).getSurfaceRegion(), with name 'a', with onDirection (0, 0, 1)",
    "offset by": f"""
ego = new Thing in yard, with name 'b'
new Thing offset by (Range(-1, 1), 1.5), {IN_PEN}""",
    "offset along": f"""
ego = new Thing in yard, with name 'b'
new Thing offset along swirl by (1, Range(0, 2)), {IN_PEN}""",
    "beyond": f"""
b = new Thing in yard, with name 'b'
new Thing beyond b by Range(1, 2) from (0, 0), {IN_PEN}""",
    "beyond from": f"""
b = new Thing in yard, with name 'b', with regionContainedIn pen
new Thing beyond (4, -8) by (0.5, 1) from b, {IN_PEN}""",
    "at point and offset": f"""
spot = Region.uniformPointIn(yard)
b = new Thing at spot, with name 'b'
new Thing at spot + Vector(2, 0, 0), {IN_PEN}""",
    "two at one point": f"""
spot = new OrientedPoint in yard
b = new Thing at spot, with name 'b', with regionContainedIn CircularRegion((3, -8), 3)
new Thing at spot, facing spot.heading, {IN_PEN}""",
    "visible": """
ego = new Thing in yard, with name 'b', with visibleDistance 3
new Thing visible, with name 'a', with regionContainedIn pen""",
    "visible from": """
b = new Point at (4, -9), with visibleDistance 3
new Thing visible from b, facing swirl, with name 'a', with regionContainedIn pen""",
    "in region, visible": """
ego = new Thing in yard, with name 'b', with visibleDistance 2
new Thing in yard, with name 'a', with requireVisible True""",
    "following": f"""
b = new Thing in yard, with name 'b'
new Thing following swirl from b for Range(1, 2), {IN_PEN}""",
    "left of object": f"""
b = new Thing in yard, with name 'b'
new Thing left of b by Range(0.2, 1), {IN_PEN}""",
    "right of point": f"""
spot = new OrientedPoint on yard
b = new Thing at spot, with name 'b'
new Thing right of spot by Range(0.2, 1), {IN_PEN}""",
    "ahead of object": f"""
b = new Thing on lane, with name 'b', with regionContainedIn pen
new Thing ahead of b by Range(0.2, 1), {IN_PEN}""",
    "behind vector": f"new Thing behind (Range(2, 6), -8) by 1, facing Range(0, 90) deg, {IN_PEN}",
    "above object": """
b = new Thing on yard, with name 'b', with regionContainedIn pen
new Thing above b by Range(0.1, 1), with name 'a'""",
    "below object": """
b = new Thing on yard, with name 'b', with regionContainedIn pen
new Thing below b by Range(0.1, 1), with name 'a'""",
    "facing field": f"new Thing in RectangularRegion((4, -8), 0, 9, 9), facing swirl, {IN_PEN}",
    "facing relative to region": f"new Thing on lane, facing Range(-20, 20) deg relative to "
    f"lane.orientation, {IN_PEN}",
    "facing toward": f"""
b = new Thing in yard, with name 'b'
new Thing on lane, facing toward b, {IN_PEN}""",
    "facing away from": f"new Backed on yard, facing away from (4, -8), {IN_PEN}",
    "facing directly toward": "new Thing in yard, facing directly toward (4, -8, Range(1, 2)), "
    "with name 'a'",
    "apparently facing": f"new Backed on yard, apparently facing 30 deg from (0, 0), {IN_PEN}",
    "mutated": f"""
a = new Thing in yard, {IN_PEN}
mutate a by 1""",
    "mutated on line": f"""
a = new Backed on lane, {IN_PEN}
mutate a by 0.5""",
    "beside": """
b = new Table in room(2), facing Range(0, 360) deg, with name 'b'
new Stool on beside(b), with name 'a'""",
}
#: Scenic cannot draw from their regions unless it prunes them to what is visible
DRAWN_BY_PRUNING = ("visible", "visible from")


@dataclass(frozen=True, slots=True)
class Draws:
    """Poses that were drawn, columns that vary."""

    rows: Array  #: (n, d) position [m] and two columns of the rotation matrix, of a and of b
    attempts: int  #: scenes drawn for them


def write(name: str, folder: Path) -> Path:
    """Write the program of a specifier."""
    path = folder / f"{name}.scenic"
    text = PROGRAMS[name]
    path.write_text(HEAD + (text if text.startswith("\n") else text + "\n"))
    return path


def our_draws(path: Path, count: int, mode: Mode, seed: int = 0) -> Draws:
    """Draw with this project's driver from uniform points of the cube."""
    program = compile_program(path)
    things = _things(program.scenario)
    points = np.random.default_rng(seed)
    find = program.search.exact if mode == "exact" else program.search.repair
    rows, attempts = [], 0
    for number in range(count):
        u = points.random(len(program.space))
        found = find(u, seed * count + number, lambda values: values)
        rows.append(_row([found.value[thing] for thing in things]))
        attempts += found.attempts
    return Draws(np.array(rows), attempts)


def scenics_draws(path: Path, count: int, *, is_pruned: bool = False, seed: int = 0) -> Draws:
    """Draw by Scenic's own ``generate``, without pruning where that is possible."""
    is_pruned = is_pruned or path.stem in DRAWN_BY_PRUNING
    kept, translator.usePruning = translator.usePruning, is_pruned
    try:
        with randomness.seeded(seed, "scenic/compile"):
            scenario = translator.scenarioFromFile(str(path))
    finally:
        translator.usePruning = kept
    things = _things(scenario)
    rows, attempts = [], 0
    with warnings.catch_warnings(), randomness.seeded(seed, "scenic/generate"):
        warnings.simplefilter("ignore")
        for _ in range(count):
            scene, tries = scenario.generate(maxIterations=20000)
            rows.append(_row([scene.sample[thing] for thing in things]))
            attempts += tries
    return Draws(np.array(rows), attempts)


def _things(scenario: Any) -> list[Any]:
    """Find a and, where there is one, b."""
    named = {getattr(thing, "name", None): thing for thing in scenario.objects}
    return [named[name] for name in ("a", "b") if name in named]


def _row(things: list[Any]) -> list[float]:
    row: list[float] = []
    for thing in things:
        row += thing.position.coordinates
        row += thing.orientation.getRotation().as_matrix()[:, :2].ravel().tolist()
    return row


# --- are two sets of draws of one distribution? ----------------------------------------------


class EnergyTest:
    """Permutation test on the energy distance of two samples of poses.

    All coordinates are compared together, with the products of position and orientation, so that
    it sees whether the two belong together.

    Args:
        one: ``(n, d)`` as in :class:`Draws`.
        other: ``(m, d)``.
        permutations: of the labels.
        seed: of the permutations.

    Reference: Szekely & Rizzo, "Testing for equal distributions in high dimension", 2004.
    """

    def __init__(self, one: Array, other: Array, *, permutations: int = 999, seed: int = 0) -> None:
        rows = np.concatenate([one, other])
        self._middle = rows.mean(axis=0)
        spread = rows.std(axis=0)
        self._spread = np.where(spread > 1e-9, spread, np.inf)
        distances = self._distances(rows)
        self._labels = np.arange(len(rows)) < len(one)
        numbers = np.random.default_rng(seed)
        self._null = np.array(
            [_energy(distances, numbers.permutation(self._labels)) for _ in range(permutations)]
        )
        self.p_value = self._p(_energy(distances, self._labels))

    def p_of(self, one: Array, other: Array) -> float:
        """Test two other samples of the same sizes with the null distribution of the first two."""
        return self._p(_energy(self._distances(np.concatenate([one, other])), self._labels))

    def _p(self, statistic: float) -> float:
        return float((1 + np.count_nonzero(self._null >= statistic)) / (1 + len(self._null)))

    def _distances(self, rows: Array) -> Array:
        told = (rows - self._middle) / self._spread
        products = told[:, :3, None] * told[:, None, 3:9]
        found: Array = squareform(pdist(np.hstack([told, products.reshape(len(rows), -1)])))
        return found


def _energy(distances: Array, first: Array) -> float:
    n = np.count_nonzero(first)
    weights = np.where(first, 1.0 / n, -1.0 / (len(first) - n))
    return float(-weights @ distances @ weights)


def drawn_apart(rows: Array, share: float, numbers: np.random.Generator) -> Array:
    """Let a share of the draws have the orientation of a that another one has."""
    chosen = np.flatnonzero(numbers.random(len(rows)) < share)
    mixed = rows.copy()
    mixed[chosen, 3:9] = rows[numbers.permutation(len(rows))[: len(chosen)], 3:9]
    return mixed


def shifted(rows: Array, share: float) -> Array:
    """Move a along x and y by a share of the standard deviation there."""
    moved = rows.copy()
    moved[:, :2] += share * rows[:, :2].std(axis=0)
    return moved
