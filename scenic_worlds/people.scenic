"""People and the ways they walk."""

from scenic.core.regions import Region

from scenic_worlds.floor import FloorObject, corridors, inside_rooms, places
from scenic_worlds.random_places import first_stop, region_of_visits


def random_route(stops=3, within=corridors):
    """A route over `stops` random points of a region."""
    return [Region.uniformPointIn(within) for _ in range(stops)]


def random_visits(stops=3, least=0):
    """A route over `stops` random points in rooms, off the points where robots work.

    Points that follow each other are `least` m apart, or as far as the floor allows. Where rooms
    have no such points, others are taken where nobody works or waits.
    """
    if least == 0:
        return random_route(stops, within=inside_rooms)
    route = []
    for number in range(stops):
        before = route[-1:] + (route[:1] if 1 < number == stops - 1 else [])
        route.append(Region.uniformPointIn(region_of_visits(places, least, *before)))
    return route


class Human(FloorObject):
    """A person who walks a route again and again.

    Properties:
        route: list of points `(x, y)`, room numbers and room names, each may be random, or the
            lane `route(a, b)`; empty: the person stands at its position.
        speed: desired walking speed [m/s].
        reacts: gives way to robots; if False, walks on and ignores them.
        repeat: starts again after the last point; False stays there.
        phase: share of the route walked at time 0, in [0, 1].
        pause: stands so long at each point of the route [s].
        appears_at, leaves_at: when the person is on the floor [s].
        body_radius: [m].
    """
    kind: 'human'
    route: ()
    position: first_stop(places, self.route, 0.85)
    width: 2 * self.body_radius
    length: 2 * self.body_radius
    height: 1.7
    speed: 1.0
    reacts: True
    repeat: True
    phase: 0.0
    pause: 0.0
    appears_at: 0.0
    leaves_at: 1e9
    body_radius: 0.25
    allowCollisions: True
    regionContainedIn: everywhere
