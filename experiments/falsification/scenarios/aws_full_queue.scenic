"""Five of six robots of the AWS hospital bring something to a ward drawn for each.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i, with cruise_speed Range(0.9, 1.3)

for i in range(8):
    new Human with name f'human{i + 1}', with route random_route(2), with speed Range(0.6, 1.3),
        with phase Range(0, 1)

param horizon = 150
param tasks = [
    delivery(Range(0, 12), i, Uniform(*[ward for ward in range(1, 6) if ward != i]), slack=150,
             service=Range(2, 10), robot=f'robot{i + 1}')
    for i in range(5)
]
