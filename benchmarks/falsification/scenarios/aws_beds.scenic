"""Beds stop in doorways of the AWS hospital for a time; six robots have work behind them.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(8):
    new Human with name f'human{i + 1}', with route random_route(2), with speed Range(0.6, 1.3),
        with phase Range(0, 1)

for i, ward in enumerate(['ward_northeast', 'ward_southeast', 'ward_southwest']):
    begin = Range(0, 40)
    new Blockage with name f'bed{i + 1}', in doorway(ward),
        with width 0.6, with length 1.4, facing Range(0, 360) deg,
        with during (begin, begin + Range(5, 25))

param horizon = 150
param tasks = [
    delivery(Range(0, 20), start, end, slack=150)
    for start, end in [(1, 2), (2, 4), (4, 1), (5, 2), (3, 4)]
]
