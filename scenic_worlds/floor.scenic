"""The floor of a scenario: its parameters, its places, and what all objects on it share.

Global parameters (a program gives them before `model scenic_worlds.model`):
    layout: a shipped name, the path of a floor, or a random floor such as
        `hospital(corridor_width=Range(2.6, 4))` of scenic_worlds.floors; 'aws_hospital' by
        default.

The functions are described in authoring.py.
"""

from scenic_worlds.authoring import PlaceFunctions
from scenic_worlds.origins import note_origin

param layout = 'aws_hospital'

_floor = PlaceFunctions(globalParameters.layout)
places = _floor.places
param _places = places
param _layout = globalParameters.layout

layout_is_random = _floor.varies
free_floor = _floor.free_floor
corridors = _floor.corridors
standing_room = _floor.standing_room
inside_rooms = _floor.inside_rooms
bed_parking = _floor.bed_parking

room = _floor.room
near = _floor.near
along_wall = _floor.along_wall
doorway = _floor.doorway
door = _floor.doorway
queue_area = _floor.queue_area
route = _floor.route
beside = _floor.beside
room_point = _floor.room_point


class FloorObject(Object):
    """Anything that stands on the floor.

    `active` False leaves it out of the world; the value may be random.
    """
    kind: 'object'
    active: True
    requireVisible: False
    occluding: False
    regionContainedIn: free_floor
    position: new Point in free_floor
    height: 1.0
    baseOffset: (0, 0, 0)
    contactTolerance: 0.0

    def _register(self):
        note_origin(self)
        super()._register()
