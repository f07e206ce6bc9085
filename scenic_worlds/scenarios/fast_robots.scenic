"""Robots that drive up to 1.5 m/s, in a long corridor with people and a trolley.

Stresses stopping distances: on straight ways the robots cruise at up to twice the usual speed, and
their limits of acceleration differ.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line', rooms=4, corridor_width=Range(2.4, 3.2), room_width=12, spots=2, station=False
)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i,
        with cruise_speed Range(0.9, 1.5), with max_acceleration Range(0.6, 1.2)

for i in range(2):
    new Human with name f'walker{i + 1}', with route random_route(2), with speed Range(0.5, 1.4)
new Trolley with name 'trolley1', in corridors, facing Range(0, 360) deg

param horizon = 200
param tasks = [
    delivery(Range(0, 10), start, end, slack=(85, 150))
    for start, end in [(0, 3), (1, Uniform(2, 3)), (2, 1), (3, 0)]
]
