"""Three deliveries between any wards of a ring, shared out among twelve robots.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='ring', rooms=12, corridor_width=2.6, room_width=4.5,
                        door_width=1.1, spots=2, station=False, parking=4)
model scenic_worlds.model

for i in range(12):
    new Robot with name f'robot{i + 1}', with start_room i, with cruise_speed Range(0.8, 1.3)

param horizon = 120
param tasks = [
    delivery(Range(0, 25), start, another_room(start), slack=120)
    for start in [any_room() for _ in range(3)]
]
