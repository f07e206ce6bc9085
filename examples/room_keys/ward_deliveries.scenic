"""Six deliveries between six rooms on one corridor, by four robots, with two visitors.

Stresses rooms: one robot at a time may be in each, and deliveries lead from any to any other one.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line', rooms=6, corridor_width=3, spots=1, station=False, parking=4
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(2):
    new Human with name f'visitor{i + 1}', with speed Range(0.6, 1.2),
        with route [(Range(11, 16), Range(-0.5, 0.5)), (Range(0, 5), Range(-0.5, 0.5))]

param horizon = 400
param tasks = burst(3, within=30, slack=(250, 400), service=(2, 10)) + burst(
    3, begin=Range(40, 120), within=30, slack=(250, 350), service=(2, 10)
)
