"""Three robots exchange goods between wards whose doors are hardly wider than a robot.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.0, room_width=5,
                        door_width=0.85, spots=1, station=False, parking=2)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i, with max_speed Range(0.7, 1.5)

param horizon = 150
param tasks = [
    delivery(Range(0, 15), 0, Uniform(1, 2, 3), slack=(74, 114), service=Range(0, 8)),
    delivery(Range(0, 15), 1, Uniform(0, 2, 3), slack=(74, 114), service=Range(0, 8)),
    delivery(Range(0, 15), 2, Uniform(0, 1, 3), slack=(74, 114), service=Range(0, 8)),
]
