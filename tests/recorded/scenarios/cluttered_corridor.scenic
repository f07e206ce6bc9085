"""Furniture stands about in a corridor that two robots have to go along.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=3.0, room_width=7,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 1

for i in range(2):
    new Chair with name f'chair{i + 1}', in corridors, facing Range(0, 360) deg
new Trolley with name 'trolley1', in corridors, facing Range(0, 360) deg

param horizon = 150
param tasks = [
    delivery(Range(0, 10), 0, Uniform(2, 3), slack=(70, 95)),
    delivery(Range(0, 10), 1, Uniform(2, 3), slack=(70, 95)),
]
