"""Two fleets through one corridor, in opposite directions at the same time.

Stresses meeting head on: four robots start at one end of a straight corridor of sampled
width and four at the other, all with deliveries to the far end at nearly the same moment.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line',
    rooms=8,
    corridor_width=Range(1.8, 2.2),
    room_width=Range(4, 6),
    door_offset=[Range(0, 1) for _ in range(8)],
    station=False,
)
model scenic_worlds.model

west, east = (0, 1, 2, 3), (4, 5, 6, 7)
for i, start in enumerate(range(8)):
    new Robot with name f'robot{i + 1}', with start_room start, with max_speed Range(0.8, 1.5)
for i in range(3):
    new Trolley with name f'trolley{i + 1}', in corridors, facing Range(-30, 30) deg

param horizon = 600
param tasks = [
    delivery(Range(0, 15), start, end, slack=(200, 320))
    for start, end in [
        (0, Uniform(*east)), (1, Uniform(*east)), (2, Uniform(*east)), (3, Uniform(*east)),
        (4, Uniform(*west)), (5, Uniform(*west)), (6, Uniform(*west)), (7, Uniform(*west)),
    ]
]
