"""Nav2 maps that tests draw themselves: four wards on a corridor, a pillar, an unknown border."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

RESOLUTION = 0.05  # m
BORDER = 20  # unknown cells around the building
WIDTH, DEPTH = 16.0, 11.0  # m, wall to wall
ROOMS = {"lab": (3.5, 2.0), "ward": (12.0, 2.0), "store": (4.0, 9.0), "desk": (12.5, 9.0)}
ROOMS_TEXT = "rooms:\n" + "".join(
    f"  - {{name: {name}, point: [{x}, {y}]}}\n" for name, (x, y) in ROOMS.items()
)
PILLAR = (8.3, 5.5)  # m, middle of the corridor
CORRIDOR = (3.6, 7.4)  # m, its walls' middles


def ward_grid(door: float = 1.3) -> np.ndarray:
    """Occupancy (rows, cols) -1, 0, 100 of the building, row 0 southernmost, origin (0, 0)."""
    inner = np.zeros((round(DEPTH / RESOLUTION), round(WIDTH / RESOLUTION)), dtype=np.int8)

    def box(x1: float, y1: float, x2: float, y2: float, value: int = 100) -> None:
        left, right = round(x1 / RESOLUTION), round(x2 / RESOLUTION)
        inner[round(y1 / RESOLUTION) : round(y2 / RESOLUTION), left:right] = value

    for y in CORRIDOR:
        box(0, y - 0.1, WIDTH, y + 0.1)
    box(7.4, 0, 7.6, CORRIDOR[0])
    box(8.4, CORRIDOR[1], 8.6, DEPTH)
    for (x, _), y in zip(ROOMS.values(), (*[CORRIDOR[0]] * 2, *[CORRIDOR[1]] * 2), strict=True):
        box(x - door / 2, y - 0.1, x + door / 2, y + 0.1, 0)
    box(PILLAR[0] - 0.2, PILLAR[1] - 0.2, PILLAR[0] + 0.2, PILLAR[1] + 0.2)
    walled = np.pad(inner, 3, constant_values=100)
    return np.pad(walled, BORDER, constant_values=-1)


def slam_grid(seed: int = 0) -> np.ndarray:
    """The same building as a mapping run leaves it: ragged walls, specks, unknown grains."""
    rng = np.random.default_rng(seed)
    grid = ward_grid()
    occupied = grid == 100
    edge = ndimage.binary_dilation(occupied) & ~occupied
    ragged = occupied | (edge & (rng.random(grid.shape) < 0.35))
    ragged &= ~(occupied & ndimage.binary_dilation(~occupied) & (rng.random(grid.shape) < 0.25))
    ragged |= ndimage.binary_erosion(occupied)  # walls stay closed
    noisy = np.where(ragged, 100, np.where(occupied, 0, grid)).astype(np.int8)
    free = noisy == 0
    noisy[free & (rng.random(grid.shape) < 0.0004)] = 100
    grains = ndimage.binary_opening(rng.random(grid.shape) < 0.05)
    noisy[free & (grains | (rng.random(grid.shape) < 0.0008))] = -1
    return noisy


def origin() -> list[float]:
    """Where the lower left corner lies so that the building begins at (0, 0)."""
    return [-(BORDER + 3) * RESOLUTION] * 2


def draw(
    folder: Path,
    grid: np.ndarray,
    *,
    name: str = "wards",
    ending: str = "pgm",
    rooms: str = ROOMS_TEXT,
    negate: bool = False,
    yaw: float = 0.0,
    corner: list[float] | None = None,
    resolution: float = RESOLUTION,
) -> Path:
    """Write a map with its rooms beside it; returns the YAML file."""
    grey = np.where(grid < 0, 128, np.where(grid > 65, 0, 254)).astype(np.uint8)
    if negate:
        grey = 255 - grey
    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(grey[::-1]).save(folder / f"{name}.{ending}")
    x, y = corner or origin()
    (folder / f"{name}.yaml").write_text(
        f"image: {name}.{ending}\nresolution: {resolution}\norigin: [{x}, {y}, {yaw}]\n"
        f"negate: {int(negate)}\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    (folder / f"{name}.rooms.yaml").write_text(rooms)
    return folder / f"{name}.yaml"
