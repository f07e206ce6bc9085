"""Deliveries to a lift and a charging bay, and one more charger on everybody's way.

Stresses places where robots stand for a time: the car of the lift, a charging bay beside the
corridor, and a charger in the corridor itself, which every robot visits that passes. How long
robots stand there is sampled, and so is which deliveries lead where.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line',
    rooms=4,
    corridor_width=Range(2.6, 3.2),
    room_width=8,
    spots=2,
    station=False,
    parking=3,
    lifts=1,
    chargers=1,
    lift_time=Range(2, 15),
    charge_time=Range(2, 15),
)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i + 3

new Charger with name 'floor_charger', at (Range(11.8, 12.6), 0),
    with width 2.6, with service_time Range(0, 8), with capacity DiscreteRange(1, 2)

param horizon = 240
param tasks = [
    delivery(Range(0, 15), start, end, slack=(90, 190), service=Range(0, 4))
    for start, end in [
        (3, 'lift_0'), ('lift_0', Uniform(4, 5)), (4, Uniform('lift_0', 'charger_0')),
        ('charger_0', 5), (5, Uniform(2, 3)),
    ]
]
