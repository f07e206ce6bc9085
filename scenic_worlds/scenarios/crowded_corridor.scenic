"""A corridor full of people, with things left along its walls.

Stresses people on the way: four of them walk to and fro in the east corridor of the AWS
hospital, at sampled speeds and between sampled points; now and then one does not look out for
robots. Three robots have to pass through, round a cart and a chair that narrow the way.
"""
model scenic_worlds.model

east = RectangularRegion((5, -11), 0, 3.2, 24).intersect(corridors)
north = RectangularRegion((5, -4), 0, 3.2, 10).intersect(corridors)
south = RectangularRegion((5, -18), 0, 3.2, 10).intersect(corridors)

for i, start in enumerate([1, 2, 3]):
    new Robot with name f'robot{i + 1}', with start_room start

for i in range(4):
    new Human with name f'walker{i + 1}',
        with route random_route(1, within=north) + random_route(1, within=south),
        with phase Range(0, 1),
        with speed Range(0.5, 1.2),
        with reacts Discrete({True: 24, False: 1})

new Trolley with name 'trolley1', in east, facing Range(-15, 15) deg
new Chair with name 'chair1', in east, facing Range(0, 360) deg

param horizon = 240
param tasks = [
    delivery(Range(0, 15), start, end, slack=(98, 165))
    for start, end in [(1, 2), (2, 1), (1, 3), (3, 1)]
]
