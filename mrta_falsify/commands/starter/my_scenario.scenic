"""A ward with a few visitors and two bursts of deliveries.

What it stresses: change this line when you know.
"""
param clear_of_doors = True
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(3):
    new Human with name f'visitor{i + 1}',
        with route [i, 5 - i],
        with speed Range(0.6, 1.3)

# A bed somewhere in a corridor, and a trolley beside it.
bed = new Bed in corridors, facing Range(0, 360) deg
new Trolley in corridors

param tasks = [
    (0, DiscreteRange(0, 2), DiscreteRange(3, 5), Range(150, 250)),
    (0, DiscreteRange(3, 5), DiscreteRange(0, 2), Range(150, 250)),
    (Range(20, 60), DiscreteRange(0, 2), DiscreteRange(3, 5), Range(250, 350)),
    (Range(20, 60), DiscreteRange(3, 5), DiscreteRange(0, 2), Range(250, 350)),
]
param horizon = 400
