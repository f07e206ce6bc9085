"""Places that only so many robots may use at once: corridors, doors, lifts, chargers, rooms.

The area of a resource is its box, `width` across the heading and `length` along it, or the outline
`area`. A robot whose way leads through the area asks for it, waits until it is granted, and gives
it back behind the area. Rooms have a resource of the floor; `RoomUse` changes it.

    new Corridor on route(0, 2), with length 6, with spots [(3, 1), (9, 1)]
    new Lift at (12, 4), with service_time Range(5, 20)
    new RoomUse with room 2, with capacity 2
"""

from scenic_worlds.floor import FloorObject, corridors


class Resource(FloorObject):
    """An area that at most `capacity` robots use at once.

    Properties:
        area: outline as points `(x, y)` [m] instead of the box.
        spots: where robots wait, the head of the queue first: points, or objects. Without spots
            they wait 0.6 m before the area, one behind the other.
        capacity: robots at once.
        service_time: [s]; see docs/scenic-library.md for what it means for each kind.
        hold: 'until_left' or 'until_served'.
        request_area: outline in which robots ask; by default all within 1 m of area and spots.
    """
    kind: 'corridor'
    area: ()
    spots: ()
    capacity: 1
    service_time: 0.0
    hold: 'until_left'
    request_area: ()
    position: new Point in corridors
    width: 1.6
    length: 4.0
    height: 0.02
    allowCollisions: True
    regionContainedIn: everywhere


class Corridor(Resource):
    """A stretch for single file, or for `capacity` robots."""
    kind: 'corridor'


class Door(Resource):
    """A door that robots pass one by one; it is free again `service_time` after they come."""
    kind: 'door'
    width: 1.4
    length: 1.2
    service_time: 3.0


class Lift(Resource):
    """A place in which a robot stands for `service_time` before it goes on."""
    kind: 'elevator'
    width: 1.8
    length: 1.8
    service_time: 12.0


class Charger(Resource):
    """A charging place on the way: a robot stands in it for `service_time`, then goes on."""
    kind: 'charger'
    width: 1.3
    length: 1.3
    service_time: 10.0


class RoomUse(FloorObject):
    """Changes how the room `room` is used; what is not given stays as the floor has it.

    Properties:
        room: number or name.
        capacity, service_time, hold, spots, area, request_area: as of a Resource.
        entry: waypoints from the head of the queue to the room's point.
    """
    kind: 'room_use'
    room: 0
    capacity: None
    service_time: None
    hold: None
    spots: None
    area: None
    request_area: None
    entry: None
    position: (0, 0, 0)
    width: 0.1
    length: 0.1
    height: 0.1
    allowCollisions: True
    regionContainedIn: everywhere
