"""Slow robots and a second batch of deliveries while the first is under way.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.8, room_width=6,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

new Robot with name 'robot1', with start_room 0, with max_speed Range(0.45, 1.2)
new Robot with name 'robot2', with start_room 3, with max_speed Range(0.45, 1.2)

param horizon = 200
param tasks = (
    [delivery(Range(0, 5), any_room(), any_room(), slack=(120, 160)) for i in range(2)]
    + [delivery(Range(15, 60), any_room(), any_room(), slack=(120, 160)) for i in range(2)]
)
