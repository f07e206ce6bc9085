"""Two fleets through one corridor, in opposite directions at the same time.

Stresses meeting head on: two robots start at one end of a straight corridor and two at the
other, all with deliveries to the far end at nearly the same moment; beds parked along the
corridor leave single file beside them, for two metres or, one behind the other, for more.
"""
from scenic_worlds.floors import hospital

corridor_width = Range(2.1, 2.8)
room_width = Range(7.5, 9)
to_the_ends = [Range(0.7, 1), Range(0, 0.3), Range(0, 0.3), Range(0.7, 1)]
param layout = hospital(
    shape='line',
    rooms=4,
    corridor_width=corridor_width,
    room_width=room_width,
    door_offset=to_the_ends,
    spots=2,
    station=False,
    parking=2,
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i, with cruise_speed Range(0.6, 1.2)

side = Uniform(-1, 1)
for i in range(2):
    passage = 0.8 + Range(0, 1) * (corridor_width - 1.85)
    new Bed with name f'bed{i + 1}', facing 90 deg,
        at (room_width * Range(0.7, 1.3), side * (passage + 0.5 - corridor_width / 2), 0)

param horizon = 200
param tasks = [
    delivery(Range(0, 10), start, end, slack=(85, 145))
    for start, end in [
        (0, Uniform(2, 3)), (1, Uniform(2, 3)), (2, Uniform(0, 1)), (3, Uniform(0, 1)),
        (Uniform(0, 1), Uniform(2, 3)), (Uniform(2, 3), Uniform(0, 1)),
    ]
]
