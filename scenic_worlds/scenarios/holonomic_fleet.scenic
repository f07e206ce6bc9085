"""Robots that can drive in every direction, in corridors with people and chairs.

Stresses holonomic bases. The default stack drives them as if they had wheels;
`--set controller.dynamics=holonomic` lets them move sideways.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='ell', rooms=4, corridor_width=Range(2, 2.8), room_width=6, spots=2, station=False
)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i, with model 'holonomic',
        facing Range(0, 360) deg

new Human with name 'walker1', with route random_route(2), with speed Range(0.5, 1.2)
for i in range(2):
    new Chair with name f'chair{i + 1}', in corridors, facing Range(0, 360) deg

param horizon = 200
param tasks = [
    delivery(Range(0, 10), start, end, slack=(60, 130))
    for start, end in [(0, 2), (1, 3), (2, 0), (3, 1)]
]
