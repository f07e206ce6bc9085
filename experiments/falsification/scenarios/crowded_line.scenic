"""Twelve robots, of which six have work, in one straight corridor with six rooms.

Scenario of the tuning set: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=6, corridor_width=2.4, room_width=6,
                        spots=2, station=False, parking=4)
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i
for i in range(6):
    new Robot with name f'idle{i + 1}', in corridors, facing Range(0, 360) deg

param horizon = 120
param tasks = [
    delivery(Range(0, 10), i, another_room(i), slack=120, robot=f'robot{i + 1}') for i in range(6)
]
