"""Four deliveries between five rooms on one corridor, by three robots, with a visitor.

Stresses rooms: one robot at a time may be in each, and deliveries lead from any to any other one.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line', rooms=5, corridor_width=3, spots=1, station=False, parking=3
)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i

new Human with name 'visitor', with speed Range(0.6, 1.2),
    with route [(Range(11, 16), Range(-0.5, 0.5)), (Range(0, 5), Range(-0.5, 0.5))]

param horizon = 250
param tasks = burst(4, within=60, slack=(170, 250), service=(2, 10))
