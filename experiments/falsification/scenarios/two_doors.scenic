"""Two doors across a corridor, near each other, that need their time to open and to close.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line', rooms=4, corridor_width=Range(2.1, 2.6), room_width=8,
    door_offset=[0.85, 0.15, 0.15, 0.85], spots=2, station=False, parking=2,
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i

first, apart = Range(5.6, 6.8), Range(1.2, 4.2)
for i, x in enumerate([first, first + apart]):
    new Door with name f'door{i + 1}', at (x, 0), facing 90 deg, with width 3,
        with service_time Range(0, 8)

param horizon = 150
param tasks = [
    delivery(Range(0, 40), start, end, slack=150, robot=f'robot{start + 1}')
    for start, end in [
        (0, Uniform(1, 2)), (1, Uniform(0, 2)), (2, Uniform(1, 3)), (3, Uniform(2, 1)),
    ]
]
