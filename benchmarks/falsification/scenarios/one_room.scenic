"""Five robots want the same room, each for a while.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=6, corridor_width=3.2, room_width=4.5,
                        spots=4, station=False, parking=2)
model scenic_worlds.model

for i in range(5):
    new Robot with name f'robot{i + 1}', with start_room i + 1, with capacity 1

param horizon = 200
param tasks = [
    delivery(Range(0, 60), i + 1, 0, slack=(90, 120), service=Range(0, 10)) for i in range(5)
]
