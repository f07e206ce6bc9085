"""Five robots of one corridor bring things to a lift, a charging bay or a ward.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line', rooms=5, corridor_width=Range(2.8, 3.2), room_width=5, spots=3,
    station=False, parking=3, lifts=1, chargers=1,
    lift_time=Range(2, 12), charge_time=Range(2, 12),
)
model scenic_worlds.model

for i in range(5):
    new Robot with name f'robot{i + 1}', with start_room i + 2

param horizon = 150
param tasks = [
    delivery(Range(0, 15), i + 2, Uniform('lift_0', 'charger_0', ward), slack=150,
             service=Range(0, 4), robot=f'robot{i + 1}')
    for i, ward in enumerate([4, 5, 6, 2, 3])
]
