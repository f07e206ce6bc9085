"""People who push things."""

from scenic_worlds.behaviors import PushAlong
from scenic_worlds.floor import bed_parking, corridors
from scenic_worlds.people import Human, random_route


class Porter(Human):
    """A person who pushes a bed along a random route and does not leave it in a doorway.

        bed = new Bed in corridors
        new Porter with load bed

    The bed is left at the stops of the route, or where it was if it cannot come to one. By
    default they lie where a bed of 1.0 x 2.2 m keeps clear of doorways, room points and waiting
    spots whichever way it points.

    Properties:
        load: what is pushed, a piece of furniture.
        route: where its centre goes, places one after the other; three random ones by default.
        pause: time at each stop [s].
        speed: of the person [m/s]; 0.8 at most while it pushes.
    """
    load: None
    route: random_route(3, within=bed_parking)
    pause: 10.0
    position: new Point in corridors
    behavior: PushAlong(self.load, self.route, pause=self.pause)
