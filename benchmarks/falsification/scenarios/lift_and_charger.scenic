"""Deliveries to a lift and a charging bay, and one more charger on everybody's way.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line', rooms=4, corridor_width=Range(2.4, 3.0), room_width=6.5, spots=2,
    station=False, parking=3, lifts=1, chargers=1,
    lift_time=Range(2, 12), charge_time=Range(2, 12),
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i + 2

new Charger with name 'floor_charger', at (Range(9.8, 10.6), 0),
    with width 2.4, with service_time Range(0, 6), with capacity 2

param horizon = 150
param tasks = [
    delivery(Range(0, 10), start, end, slack=56, service=Range(0, 4))
    for start, end in [
        (2, 'lift_0'), (3, Uniform('lift_0', 'charger_0')), (4, 'charger_0'), (5, Uniform(2, 3)),
    ]
]
