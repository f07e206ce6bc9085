"""Porters, rush hours, furniture clear of doors, and what lies outside its region."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon

from mrta_falsify.core.directives import Push, Wait
from mrta_falsify.core.errors import WorldError
from scenic_worlds.places import CLEAR_OF_DOORS, places_of
from scenic_worlds.program import compile_program
from scenic_worlds.streams import rush_arrival

pytestmark = pytest.mark.filterwarnings("ignore")

WARD = """
PARAM
model scenic_worlds.model
new Robot with name 'robot1', with start_room 0
THINGS
param tasks = TASKS
"""


def program_of(folder, things="", *, param="", tasks="[(0, 1, 2, 240)]"):
    path = folder / "ward.scenic"
    text = WARD.replace("PARAM", param).replace("THINGS", things).replace("TASKS", tasks)
    path.write_text(text)
    return compile_program(path)


# --- porters -------------------------------------------------------------------------------------

PORTER = """
bed = new Bed in corridors, facing Range(0, 360) deg, with name 'bed'
new Porter with name 'porter', with load bed, with pause Range(5, 9)
"""


@pytest.mark.slow
def test_a_porter_pushes_the_bed_from_stop_to_stop_and_keeps_it(tmp_path):
    world = program_of(tmp_path, PORTER).sample(1)
    (porter,) = world.humans
    assert [type(directive) for directive in porter.directives] == [Push, Wait] * 3
    assert {push.furniture for push in porter.directives[::2]} == {"bed"}
    assert all(push.keeps for push in porter.directives[::2])
    assert all(5 <= wait.duration <= 9 for wait in porter.directives[1::2])
    assert next(thing for thing in world.furniture if thing.name == "bed").movable


@pytest.mark.parametrize("layout", ["aws_hospital", "warehouse"])
def test_a_bed_at_its_parking_reaches_into_no_doorway_whichever_way_it_points(layout):
    places = places_of(layout)
    shape = places.bed_parking.polygons
    assert shape.area > 20
    doors = [places._doorway_shape(i) for i, r in enumerate(places.layout.rooms) if len(r.door) > 1]
    rooms = shapely.points([room.point for room in places.layout.rooms])
    corner = np.hypot(1.0, 2.2) / 2
    for kept in (*doors, *rooms):
        assert shape.distance(kept) > corner


# --- rush hours ----------------------------------------------------------------------------------


def arrivals(load, **changes):
    rates = {"base": 0.01, "peak": 0.1, "peak_begin": 100, "peak_end": 200, "begin": 0, "end": 300}
    return rush_arrival(load, **(rates | changes))


def test_arrivals_of_a_rush_hour_are_where_so_many_tasks_are_expected():
    assert arrivals(0.5) == pytest.approx(50)
    assert arrivals(1.0 + 5.0) == pytest.approx(150)
    assert arrivals(1.0 + 10.0 + 0.5) == pytest.approx(250)
    assert arrivals(12.5) == 300  # after the window
    assert arrivals(0.0, base=0.0) == 100
    assert arrivals(2.0, begin=150) == pytest.approx(170)
    assert arrivals(1.5, peak_end=900) == pytest.approx(105)


@pytest.mark.parametrize(
    ("changes", "name"),
    [({"base": -1}, "base"), ({"peak": -0.1}, "peak"), ({"end": -5}, "between"),
     ({"peak_end": 50}, "peak_between")],
)  # fmt: skip
def test_rates_and_times_of_a_rush_hour_are_checked(changes, name):
    with pytest.raises(WorldError, match=name):
        arrivals(1.0, **changes)


@pytest.mark.slow
def test_most_tasks_of_a_rush_hour_come_in_it(tmp_path):
    stream = "rush_hour(1/300, 1/10, peak_between=(100, 160), between=(0, 300), most=14)"
    program = program_of(tmp_path, tasks=stream)
    times = np.array(
        [t.arrival for k in range(60) for t in program.realise(program.candidate(2, k)).world.tasks]
    )
    inside = np.count_nonzero((times >= 100) & (times < 160)) / 60
    before = np.count_nonzero(times < 100) / 60
    assert times.max() < 300
    assert inside == pytest.approx(6.0, abs=4 * np.sqrt(6.0 / 60))
    assert before == pytest.approx(1 / 3, abs=4 * np.sqrt(1 / 3 / 60))


# --- clear of doors ------------------------------------------------------------------------------


def gaps_to_doors(program, count=12):
    places = places_of("aws_hospital")
    doors = shapely.union_all(
        [places._doorway_shape(i) for i, r in enumerate(places.layout.rooms) if len(r.door) > 1]
    )
    worlds = [program.realise(program.candidate(4, k)).world for k in range(count)]
    stools = [f for world in worlds for f in world.furniture if f.name == "stool_1"]
    return [Polygon(stool.polygon).distance(doors) for stool in stools]


@pytest.mark.slow
def test_furniture_keeps_clear_of_doors_where_the_program_or_the_piece_says_so(tmp_path):
    door = next(r.door for r in places_of("aws_hospital").layout.rooms if len(r.door) > 1)
    x, y = door.mean(axis=0)
    near = f"new Stool in CircularRegion(({x}, {y}), 1.8)"
    least = CLEAR_OF_DOORS - 0.05  # corners of the zone are cut
    own = program_of(tmp_path, f"{near}, with clear_of_doors True")
    assert min(gaps_to_doors(own)) > least
    every = program_of(tmp_path, near, param="param clear_of_doors = True")
    assert min(gaps_to_doors(every)) > least
    off = f"{near}, with clear_of_doors False"
    one_off = program_of(tmp_path, off, param="param clear_of_doors = True")
    assert min(gaps_to_doors(one_off)) < least


@pytest.mark.slow
def test_furniture_is_where_it_was_unless_the_property_is_on(tmp_path):
    program = program_of(tmp_path, "new Trolley in corridors")
    (thing,) = [item for item, name in program.search.driver.names.items() if name == "trolley_1"]
    assert thing.regionContainedIn.name == "standing_room"


# --- outside of regions --------------------------------------------------------------------------


@pytest.mark.slow
def test_check_counts_the_draws_in_which_each_thing_is_outside_its_region(tmp_path):
    import mrta_falsify as mf

    things = """
new Bed in corridors, facing Range(0, 360) deg, with name 'bed'
new Stool at (4, -8), with name 'fixed'
"""
    program_of(tmp_path, things)
    found = {one.name: one for one in mf.check(tmp_path / "ward.scenic", count=30).outside}
    assert found["bed"].region == "standing_room"
    assert found["bed"].placed == "corridors"
    assert "standing_room" in found["bed"].advice
    assert found["bed"].where.endswith("ward.scenic:6")
    assert 0 < found["bed"].draws < found["bed"].of == 30
    assert "fixed" not in found
