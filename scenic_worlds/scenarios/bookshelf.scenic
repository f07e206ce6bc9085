"""Bookshelves at sampled distances from the wall: the example of the MRTA-Sim paper.

Stresses the costmap and what plans make of it: six shelves in the west corridor of the AWS
hospital stand anywhere between the wall and the lane, so paths must go round them, on the side
that is left.
"""
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room [0, 4, 5, 3][i]

# The corridor's west wall is at x = -6.5; a shelf stands with its back to it.
for i in range(6):
    distance = Range(0.05, 2.2)
    new Bookshelf with name f'bookshelf{i + 1}',
        at (-6.4 + 0.15 + distance, Range(-20.5, -18.5) + 3 * i, 0),
        facing -90 deg

param horizon = 600
param tasks = [
    delivery(Range(0, 20), start, end, slack=(200, 300))
    for start, end in [(0, 4), (4, 0), (5, 4), (4, 5), (5, 3), (3, 5), (0, 5)]
]
