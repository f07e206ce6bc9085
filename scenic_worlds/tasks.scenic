"""Task streams: lists of tuples for `param tasks`.

A task is `(arrival_s, start_room, end_room, deadline_s[, pickup_s[, dropoff_s[, active[, robot]]]])`,
any entry random; `active` False leaves it out, `robot` is the only one that may serve it. Streams
are joined with `+`::

    param tasks = burst(4, begin=Range(0, 60)) + poisson(1/60, between=(60, 600))
    param tasks = rush_hour(1/180, 1/20, peak_between=(200, 320))
    param tasks = for_robot('robot1', burst(2)) + burst(2)

The functions are described in streams.py.
"""

from scenic_worlds.floor import layout_is_random, places
from scenic_worlds.streams import Streams

_streams = Streams(places, varies=layout_is_random)
any_room = _streams.any_room
another_room = _streams.another_room
delivery = _streams.delivery
burst = _streams.burst
poisson = _streams.poisson
rush_hour = _streams.rush_hour
hot_room = _streams.hot_room
tight_deadlines = _streams.tight_deadlines
for_robot = _streams.for_robot
