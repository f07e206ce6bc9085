"""Two robots and three deliveries, now and then one whose deadline nobody can meet.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.8, room_width=6,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 3

param horizon = 200
param tasks = [delivery(Range(0, 40), any_room(), any_room(), slack=(5, 120)) for i in range(3)]
