"""Twelve robots on a ring; six bring things to four wards.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='ring', rooms=12, corridor_width=2.6, room_width=4.5,
                        door_width=1.1, spots=2, station=False, parking=4)
model scenic_worlds.model

for i in range(12):
    new Robot with name f'robot{i + 1}', with start_room i, with cruise_speed Range(0.8, 1.3)

param horizon = 120
param tasks = [
    delivery(Range(0, 10), i, Uniform(1, 4, 7, 10), slack=120, service=Range(2, 10),
             robot=f'robot{i + 1}')
    for i in [0, 2, 3, 5, 8, 11]
]
