"""Doors hardly wider than a robot, used in both directions.

Stresses doorways: each ward of a ring-shaped floor has a sampled door of 0.8 to 1.0 m at a
sampled place and one waiting spot only; deliveries go into each ward while others leave it.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    rooms=6,
    corridor_width=Range(1.8, 2.6),
    door_width=[Range(0.8, 1.0) for _ in range(6)],
    door_offset=[Range(0, 1) for _ in range(6)],
    spots=1,
)
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i + 1

param horizon = 300
param tasks = [
    delivery(Range(0, 15), start, end, slack=(95, 175))
    for start, end in [(1, 2), (2, 1), (3, 4), (4, 3), (5, 6), (6, 5), (2, 5), (5, 2)]
]
