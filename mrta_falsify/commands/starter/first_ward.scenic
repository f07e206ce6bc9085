"""A ward with two visitors, two robots and time enough: for a stack that takes its first steps.

What it stresses: change this line when you know.
"""
param clear_of_doors = True
model scenic_worlds.model

for i in range(2):
    new Robot with name f'robot{i + 1}', with start_room 2 * i

for i in range(2):
    new Human with name f'visitor{i + 1}',
        with route [i, 5 - i],
        with speed Range(0.6, 1.3)

new Trolley in corridors

param tasks = [
    (0, DiscreteRange(0, 2), DiscreteRange(3, 5), Range(400, 600)),
    (Range(20, 60), DiscreteRange(3, 5), DiscreteRange(0, 2), Range(400, 600)),
]
param horizon = 600
