"""What happens during a run: ways that are blocked for a time, links that fail for a time."""

from scenic_worlds.floor import FloorObject, corridors


class Blockage(FloorObject):
    """A solid that stands in the way from `during[0]` to `during[1]` [s], as a parked bed does.

    It may be placed where nothing else stands at that time; a random `during` whose end comes
    before its start rejects the scene.
    """
    kind: 'blockage'
    during: (0, 1e9)
    position: new Point in corridors
    width: 1.0
    length: 2.2
    height: 0.95
    allowCollisions: True
    regionContainedIn: everywhere


class CommsOutage(FloorObject):
    """Links of some robots that are down from `during[0]` to `during[1]` [s].

    Properties:
        robots: names or robot objects; empty: all robots.
        links: any of 'dispatcher', 'planner', 'states', 'leader'.
        during: start and end [s].
    """
    kind: 'comms_outage'
    robots: ()
    links: ('dispatcher', 'planner', 'states', 'leader')
    during: (0, 1e9)
    position: (0, 0, 0)
    width: 0.1
    length: 0.1
    height: 0.1
    allowCollisions: True
    regionContainedIn: everywhere
