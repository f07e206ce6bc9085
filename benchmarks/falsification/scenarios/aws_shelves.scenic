"""Shelves stand off the wall in the west corridor of the AWS hospital, where people walk too.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i

# The corridor's west wall is at x = -6.5; a shelf stands with its back to it.
for i in range(5):
    distance = Range(0.05, 2.2)
    new Bookshelf with name f'bookshelf{i + 1}',
        at (-6.4 + 0.15 + distance, Range(-20.5, -18.5) + 3 * i, 0),
        facing -90 deg

for i in range(8):
    new Human with name f'human{i + 1}', with route random_route(2), with speed Range(0.6, 1.3),
        with phase Range(0, 1)

param horizon = 150
param tasks = [
    delivery(Range(0, 20), start, end, slack=150)
    for start, end in [(5, 4), (4, 5), (0, 1)]
]
