"""World model for multi-robot task allocation on a building floor.

Global parameters:
    layout (str): name of the floor, 'aws_hospital' by default.
    tasks (list): tuples (arrival_s, start_room, end_room, deadline_s); any entry may be random.
    horizon (float): the episode ends at this time at the latest [s], 900 by default.

Regions: `free_floor`, `corridors`, `room(i)` by number or name.
Lengths in metres, speeds in m/s, times in seconds. Scenic's heading 0 points to +y (north).
"""

import math

from scenic_worlds.places import places_of

param layout = 'aws_hospital'
param tasks = ()
param horizon = 900.0

places = places_of(globalParameters.layout)
param _places = places
free_floor = places.free_floor
corridors = places.corridors

workspace = Workspace(free_floor)


def room(place):
    """Free floor of a room, by number or name."""
    return places.room(place)


def home_of(start_room):
    """Position of a robot parked in a room."""
    x, y = places.room_point(start_room)
    return Vector(x, y, 0.075)


def first_stop(route):
    """Position of a person at the first stop of a route."""
    stop = places.room_point(route[0]) if isinstance(route[0], (int, str)) else route[0]
    return Vector(stop[0], stop[1], 0.85)


class FloorObject(Object):
    """Anything that stands on the floor."""
    kind: 'object'
    requireVisible: False
    occluding: False
    regionContainedIn: free_floor
    position: new Point in free_floor
    height: 1.0
    baseOffset: (0, 0, 0)
    contactTolerance: 0.0


class Furniture(FloorObject):
    """Something solid; its footprint is width x length."""
    kind: 'furniture'


class Bed(Furniture):
    kind: 'bed'
    width: 1.0
    length: 2.1
    height: 0.9


class Chair(Furniture):
    kind: 'chair'
    width: 0.55
    length: 0.55
    height: 0.8


class Desk(Furniture):
    kind: 'desk'
    width: 1.6
    length: 0.8
    height: 0.75


class Bookshelf(Furniture):
    kind: 'bookshelf'
    width: 0.9
    length: 0.4
    height: 1.8


class Cabinet(Furniture):
    kind: 'cabinet'
    width: 0.8
    length: 0.5
    height: 1.2


class Trolley(Furniture):
    kind: 'trolley'
    width: 0.6
    length: 0.9
    height: 1.0


class Wheelchair(Furniture):
    kind: 'wheelchair'
    width: 0.65
    length: 1.05
    height: 0.95


class IVStand(Furniture):
    kind: 'iv_stand'
    width: 0.45
    length: 0.45
    height: 1.7


class TrashBin(Furniture):
    kind: 'trash_bin'
    width: 0.4
    length: 0.4
    height: 0.6


class Robot(FloorObject):
    """A robot at a position, or parked at the point of `start_room`."""
    kind: 'robot'
    start_room: None
    position: home_of(self.start_room)
    width: 0.30
    length: 0.30
    height: 0.15
    robotModel: 'waffle'
    maxSpeed: 1.5
    capacity: 2


class Human(FloorObject):
    """A person who walks `route` (points, room numbers or room names) at `speed`."""
    kind: 'human'
    route: []
    position: first_stop(self.route)
    width: 0.5
    length: 0.5
    height: 1.7
    speed: 1.0
    reacts: True
    repeat: True
    allowCollisions: True
    regionContainedIn: everywhere
