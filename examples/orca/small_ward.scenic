"""Four robots and four rooms on one corridor, with two visitors and a trolley.

Stresses meetings: robots that come from both ends pass each other, people and the trolley.
"""
from scenic_worlds.floors import hospital

width = Range(2.2, 3)
param layout = hospital(
    shape='line', rooms=4, corridor_width=width, spots=2, station=False, parking=4
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(2):
    new Human with name f'visitor{i + 1}', with speed Range(0.6, 1.2),
        with route [(Range(12, 14), Range(-0.5, 0.5)), i]

new Trolley with name 'trolley', in corridors, facing Range(0, 360) deg

param horizon = 150
param tasks = burst(4, within=10, slack=(80, 130)) + burst(
    2, begin=Range(15, 30), within=10, slack=(80, 130)
)
