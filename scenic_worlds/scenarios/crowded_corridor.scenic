"""A corridor full of people, with things left along its walls.

Stresses people on the way: seven of them walk to and fro in the east corridor of the AWS
hospital, at sampled speeds and between sampled points; one does not look out for robots. Four
robots have to pass through, round carts and a chair that narrow the way.
"""
model scenic_worlds.model

east = RectangularRegion((5, -11), 0, 3.2, 24).intersect(corridors)
north = RectangularRegion((5, -4), 0, 3.2, 10).intersect(corridors)
south = RectangularRegion((5, -18), 0, 3.2, 10).intersect(corridors)

for i, start in enumerate([0, 1, 2, 3]):
    new Robot with name f'robot{i + 1}', with start_room start

for i in range(7):
    new Human with name f'walker{i + 1}',
        with route random_route(1, within=north) + random_route(1, within=south),
        with phase Range(0, 1),
        with speed Range(0.5, 1.4),
        with reacts i > 0

for i in range(2):
    new Trolley with name f'trolley{i + 1}', in east, facing Range(-15, 15) deg
new Chair with name 'chair1', in east, facing Range(0, 360) deg

param horizon = 600
param tasks = [
    delivery(Range(0, 10), start, end, slack=(240, 360))
    for start, end in [(0, 2), (1, 3), (2, 0), (3, 1), (0, 3), (2, 1)]
]
