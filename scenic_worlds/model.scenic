"""World model for multi-robot task allocation on a building floor.

    model scenic_worlds.model
    for i in range(4):
        new Robot with start_room i
    new Human with route [0, 'ward_northeast'], with speed Range(0.6, 1.4)
    new Bed on along_wall('ward_southwest')
    param tasks = [(0, 1, 2, 240), (Range(0, 60), 3, DiscreteRange(0, 5), 300)]

Global parameters, all of them readable and searchable when random:
    layout: name of a shipped floor, path of a floor, or a random floor; give it before the
        `model` line. 'aws_hospital' by default.
    tasks: list of (arrival_s, start_room, end_room, deadline_s[, pickup_s[, dropoff_s[, active
        [, robot]]]]).
    horizon: the episode ends at this time at the latest [s], 900.
    ray_noise: standard deviation of measured obstacle distances [m], 0.
    noise_seed: of all noise inside the episode; the candidate's own by default.
    stack_params: parameters of a foreign stack, a list of (name, number); over those of its file.
    clear_of_doors: furniture stands off doorways by what a robot needs to pass; give it before the
        `model` line. False by default; a piece's own `clear_of_doors` goes before it.
    restrict: least and largest share of the range of search dimensions, by name; plain Scenic
        ignores it.
Places: `free_floor`, `corridors`, `standing_room`, `inside_rooms`, `bed_parking`, `room(i)`, `near(i)`, `along_wall(i)`,
    `doorway(i)`, `queue_area(i)`, `route(i, j)`, `beside(thing)`, `room_point(i)`.
Objects: `Robot`, `Human`, `Porter`, the furniture of furniture.scenic, `Blockage`, `CommsOutage`;
    `Corridor`, `Door`, `Lift`, `Charger`, `RoomUse` for what robots use in turn.
Streams: `burst`, `poisson`, `rush_hour`, `hot_room`, `tight_deadlines`, `delivery`, `for_robot`,
    `any_room`, `another_room`; routes: `random_route`, `random_visits`.
Lengths in metres, speeds in m/s, times in seconds. Scenic's heading 0 points to +y (north).
The reference with pictures is docs/scenic-library.md.
"""

from scenic_worlds.simulating import pybullet_simulator

from scenic_worlds.floor import *
from scenic_worlds.furniture import *
from scenic_worlds.robots import *
from scenic_worlds.people import *
from scenic_worlds.behaviors import *
from scenic_worlds.porters import *
from scenic_worlds.events import *
from scenic_worlds.resources import *
from scenic_worlds.tasks import *
from scenic_worlds.verifai_names import VerifaiDiscreteRange, VerifaiOptions, VerifaiRange

simulator pybullet_simulator()

param tasks = ()
param horizon = 900.0
param ray_noise = 0.0

workspace = Workspace(everywhere if layout_is_random else free_floor)
