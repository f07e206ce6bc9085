"""More robots than places to park, on a floor with narrow corridors.

Stresses the way out of the way: six robots share four rooms, and at most two parking places. Who
has delivered finds every refuge taken, and waits where others drive.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line',
    rooms=4,
    corridor_width=Range(1.8, 2.4),
    room_width=Range(5, 7),
    spots=1,
    station=False,
    parking=DiscreteRange(0, 2),
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i
for i in range(2):
    new Robot with name f'robot{i + 5}', in corridors

param horizon = 240
param tasks = burst(3, within=10, slack=(70, 150)) + burst(
    3, begin=Range(30, 50), within=10, slack=(80, 160)
)
