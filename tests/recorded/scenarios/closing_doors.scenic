"""Beds stop in two doorways for a time while three robots have work behind and beside them.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.6, room_width=6,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(2):
    begin = Range(0, 30)
    new Blockage with name f'bed{i + 1}', in doorway(i),
        with width 0.6, with length 1.4, facing Range(-130, -50) deg,
        with during (begin, begin + Range(5, 25))

param horizon = 150
param tasks = [
    delivery(Range(0, 10), 0, 3, slack=(69, 99)),
    delivery(Range(0, 10), 1, 3, slack=(69, 99)),
    delivery(Range(0, 10), 2, Uniform(0, 1), slack=(69, 99)),
]
