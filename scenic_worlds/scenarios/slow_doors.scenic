"""Two doors across a corridor that need their time to open and to close.

Stresses doors as resources: how long each door takes and how far apart the two are is sampled.
Between doors that are near each other no robot can wait, so that both must be granted together.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line',
    rooms=4,
    corridor_width=Range(2.3, 2.8),
    room_width=9,
    door_offset=[0.85, 0.15, 0.15, 0.85],
    spots=2,
    station=False,
    parking=2,
)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i

first, apart = Range(6.6, 7.6), Range(1.4, 4.2)
for i, x in enumerate([first, first + apart]):
    new Door with name f'door{i + 1}', at (x, 0), facing 90 deg, with width 3,
        with service_time Range(0, 12)

param horizon = 240
param tasks = [
    delivery(Range(0, 15), start, end, slack=(80, 170))
    for start, end in [
        (0, Uniform(2, 3)), (1, Uniform(2, 3)), (2, Uniform(0, 1)), (Uniform(2, 3), Uniform(0, 1)),
        (Uniform(0, 1), Uniform(2, 3)),
    ]
]
