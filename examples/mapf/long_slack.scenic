"""Three robots, four rooms and a trolley on one corridor, a visitor, and time enough.

Stresses what a plan of discrete steps does not know: bodies, people, doors.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line',
    rooms=4,
    corridor_width=Range(2.2, 3),
    spots=2,
    station=False,
    parking=3,
)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i

new Human with name 'visitor', with speed Range(0.6, 1.2),
    with route [(Range(11, 14), Range(-0.5, 0.5)), (Range(0, 3), Range(-0.5, 0.5))]

new Trolley with name 'trolley', in corridors, facing Range(0, 360) deg

param horizon = 150
param tasks = burst(3, within=10, slack=(120, 130))
