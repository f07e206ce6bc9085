"""Twelve robots exchange things between the wards of a ring with narrow corridors.

Scenario of the tuning set: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='ring', rooms=12, corridor_width=2.2, room_width=4.5,
                        door_width=1.1, spots=2, station=False, parking=4)
model scenic_worlds.model

for i in range(12):
    new Robot with name f'robot{i + 1}', with start_room i, with cruise_speed Range(0.6, 1.2)

param horizon = 140
param tasks = [
    delivery(Range(0, 10), i, another_room(i), slack=115, service=Range(0, 5)) for i in range(8)
]
