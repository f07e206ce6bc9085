"""Doors of floors that were drawn with known ones: found of those there, and none beside them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from PIL import Image
from shapely.geometry import Point, Polygon

from mrta_falsify.commands.floor_import import import_floor
from reports.colours import UNSAFE
from scenic_worlds.layouts import load_layout
from scenic_worlds.layouts.derivation import derive_layout
from simulator_interface.formats.floor_yaml import read_floor
from tests.drawn_maps import draw
from tests.drawn_offices import Office, Place, occupancy, office

CELL = 0.05  # m, of the floor that ways are derived on


def drawn(folder, plan: Office, *, resolution: float = 0.05, turned: float = 0.0, noise=None):
    """Write a floor as a map with rooms; its file, and the matrix that turned it."""
    grid, corner, turn = occupancy(plan, resolution=resolution, turned=turned, noise=noise)
    rooms = "rooms:\n" + "".join(
        f"  - {{name: {place.name}, point: {(turn @ place.point).round(4).tolist()}}}\n"
        for place in plan.places
    )
    path = draw(
        folder, grid, name="office", rooms=rooms, corner=corner.tolist(), resolution=resolution
    )
    return path, turn


def is_door_of(place: Place, door: np.ndarray) -> bool:
    """Whether a segment lies in a hole of the room's wall, and is as wide as it."""
    width = np.hypot(*(door[1] - door[0]))
    for x1, y1, x2, y2 in place.doors:
        hole = shapely.box(x1, y1, x2, y2)
        is_there = hole.distance(Point(door.mean(axis=0))) <= 2 * CELL
        if is_there and abs(width - max(x2 - x1, y2 - y1)) <= 3 * CELL:
            return True
    return False


@pytest.mark.parametrize(
    ("kind", "door", "corridor", "wall", "resolution", "turned"),
    [
        ("plain", 0.8, 1.0, 0.15, 0.05, 0.0),
        ("plain", 0.9, 1.5, 0.1, 0.1, 0.0),
        ("plain", 1.0, 1.75, 0.05, 0.05, 0.0),
        ("shifted", 1.2, 1.0, 0.15, 0.05, 0.0),
        ("shifted", 0.95, 3.0, 0.15, 0.05, 0.4),
        ("corners", 0.95, 2.0, 0.15, 0.05, 0.0),
        ("corners", 1.0, 1.2, 0.3, 0.05, 0.0),
        ("series", 0.9, 1.75, 0.15, 0.05, 0.0),
        ("two_doors", 1.2, 2.5, 0.15, 0.05, 0.9),
        ("furniture", 1.0, 1.5, 0.15, 0.05, 0.0),
    ],
)
def test_doors_are_found_whatever_the_corridor_is(
    tmp_path, kind, door, corridor, wall, resolution, turned
):
    plan = office(kind, door=door, corridor=corridor, wall=wall)
    path, turn = drawn(tmp_path, plan, resolution=resolution, turned=turned)
    world = load_layout(path)
    for place, room, use in zip(plan.places, world.rooms, world.resources, strict=True):
        assert len(room.door) == 2, place.name
        assert is_door_of(place, room.door @ turn), (place.name, (room.door @ turn).tolist())
        inside, area = shapely.box(*place.box), Polygon(room.area @ turn)
        assert area.within(inside.buffer(wall + 2 * CELL, join_style="mitre")), place.name
        # Of a room that leads to another one, its robot has a part.
        least = {"furniture": 0.7, "series": 0.1}.get(kind, 0.9)
        assert area.intersection(inside).area >= least * inside.area
        assert not any(inside.contains(Point(spot)) for spot in use.spots @ turn), place.name


@pytest.mark.parametrize("kind", ["opening", "alcove"])
def test_a_room_that_is_open_has_no_door(tmp_path, kind):
    plan = office(kind, door=0.9, corridor=2.0)
    world = load_layout(drawn(tmp_path, plan)[0])
    without = {room.name for room in world.rooms if not len(room.door)}
    assert without == {place.name for place in plan.places if not place.doors} == {"s1", "n1"}
    for place, use in zip(plan.places, world.resources, strict=True):
        if place.doors or kind == "alcove":  # a bay as wide as its opening ends nowhere
            assert not any(shapely.box(*place.box).contains(Point(spot)) for spot in use.spots)


def test_a_place_in_a_hall_does_not_take_the_doors_of_the_rooms_beside_it(tmp_path):
    plan = Office((14.2, 9.2), free=[(0.1, 4.1, 14.1, 9.1)])
    plan.places.append(Place("hall", (7.0, 6.5), plan.free[0], ()))
    for name, x in (("left", 0.1), ("right", 8.0)):
        hole = (x + 2.0, 3.9, x + 3.0, 4.2)
        box = (x, 0.1, x + 6.0, 4.0)
        plan.free += [box, hole]
        plan.places.append(Place(name, (x + 3.0, 2.0), box, (hole,)))
    world = load_layout(drawn(tmp_path, plan)[0])
    assert [len(room.door) for room in world.rooms] == [0, 2, 2]
    assert Polygon(world.rooms[0].area).area < 6.0


def test_an_area_around_a_place_ends_at_the_walls(tmp_path):
    """A place in a narrow corridor is no part of the rooms on the other side of its walls."""
    plan = office("plain", door=0.9, corridor=1.5)
    corridor = plan.free[0]
    plan.places.append(Place("post", (9.5, 4.95), corridor, ()))
    world = load_layout(drawn(tmp_path, plan)[0])
    post = world.rooms[-1]
    assert len(post.door) == 0
    assert Polygon(post.area).within(shapely.box(*corridor).buffer(CELL))


def test_import_says_where_no_door_was_found_and_marks_it(tmp_path):
    colour = np.array([int(UNSAFE[k : k + 2], 16) for k in (1, 3, 5)])

    def marks(kind: str) -> tuple[list[str], int]:
        done = import_floor(
            drawn(tmp_path / kind, office(kind, corridor=2.0))[0], tmp_path / kind / "out"
        )
        pixels = np.asarray(Image.open(done.picture).convert("RGB")).astype(int)
        said = [warning for warning in done.warnings if "no door was found" in warning]
        return said, int((np.abs(pixels - colour).max(axis=-1) < 12).sum())

    (said,), red = marks("opening")
    assert "s1, n1" in said
    assert red > 200
    assert marks("plain") == ([], 0)


def test_a_given_door_closes_a_room_as_a_found_one_does(tmp_path):
    plan = office("plain", door=1.0, corridor=1.75)
    path, _ = drawn(tmp_path, plan)
    found = load_layout(path)
    rooms = path.with_name("office.rooms.yaml")
    lines = rooms.read_text().splitlines()
    door = found.rooms[0].door.round(3).tolist()
    lines[1] = lines[1].replace("}", f", door: {door}}}")
    rooms.write_text("\n".join(lines))
    again = load_layout(path)
    assert again.rooms[0].door == pytest.approx(np.array(door))
    areas = [Polygon(world.rooms[0].area) for world in (found, again)]
    assert areas[0].symmetric_difference(areas[1]).area < 0.2


def test_progress_goes_up_to_its_end(tmp_path):
    floor = read_floor(drawn(tmp_path, office("plain", corridor=2.5))[0])
    seen: list[tuple[float, float]] = []
    derive_layout(floor, on_progress=lambda done, total: seen.append((done, total)))
    done = [step for step, _ in seen]
    assert done == sorted(set(done))
    assert seen[-1][0] == seen[-1][1]
