"""Two robots pass each other in a corridor that a parked bed narrows.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.4, room_width=7.5,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

new Robot with name 'robot1', with start_room 0, with max_speed Range(0.8, 1.5)
new Robot with name 'robot2', with start_room 3, with max_speed Range(0.8, 1.5)

passage = 0.8 + Range(0, 0.5)
new Bed with name 'bed1', facing 90 deg,
    at (7.5 * Range(0.7, 1.3), passage + 0.5 - 1.2, 0)

param horizon = 120
param tasks = [
    delivery(Range(0, 10), 0, Uniform(2, 3), slack=(62, 82)),
    delivery(Range(0, 10), 3, Uniform(0, 1), slack=(62, 82)),
]
