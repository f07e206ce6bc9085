"""Bookshelves at sampled distances from the wall: the example of the MRTA-Sim paper.

Stresses the costmap and what plans make of it: six shelves in the west corridor of the AWS
hospital stand anywhere between the wall and the lane, so paths must go round them, on the side
that is left, and robots meet where one of them has to wait.
"""
model scenic_worlds.model

for i, start in enumerate(['ward_northwest', 'ward_southwest', 'ward_southwest']):
    new Robot with name f'robot{i + 1}', in near(start, 0.9)

# The corridor's west wall is at x = -6.5; a shelf stands with its back to it.
for i in range(6):
    distance = Range(0.05, 2.2)
    new Bookshelf with name f'bookshelf{i + 1}',
        at (-6.4 + 0.15 + distance, Range(-20.5, -18.5) + 3 * i, 0),
        facing -90 deg

param horizon = 240
param tasks = [
    delivery(Range(0, 20), start, end, slack=(65, 125))
    for start, end in [(5, 4), (4, 5), (4, 5), (5, 4)]
]
