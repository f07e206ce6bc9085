"""Four robots on a floor of random shape, widths and doors; a chair stands in one of its wards.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

WARDS = 6
param layout = hospital(
    shape=Uniform('ring', 'ell', 'comb'),
    rooms=WARDS,
    corridor_width=Range(2.2, 3.2),
    cross_width=Range(2.2, 3.2),
    room_width=[Range(4, 6) for _ in range(WARDS)],
    door_width=[Range(1.0, 1.4) for _ in range(WARDS)],
    door_offset=[Range(0, 1) for _ in range(WARDS)],
    spots=1, station=False, parking=2,
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i
new Chair with name 'chair1', in inside_rooms, facing Range(0, 360) deg

param horizon = 150
param tasks = [delivery(Range(0, 10), i, another_room(i), slack=150) for i in range(2)]
