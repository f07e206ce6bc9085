"""Four robots in a corridor of random width, with wards of random size behind random doors.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line', rooms=4,
    corridor_width=Range(1.8, 2.6),
    room_width=[Range(3.5, 6) for _ in range(4)],
    room_depth=[Range(2.6, 5) for _ in range(4)],
    door_width=[Range(0.8, 1.2) for _ in range(4)],
    door_offset=[Range(0, 1) for _ in range(4)],
    spots=1, station=False, parking=1,
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i, with max_speed Range(0.7, 1.5)

param horizon = 150
param tasks = [
    delivery(Range(0, 10), i, another_room(i), slack=150, service=Range(0, 8)) for i in range(4)
]
