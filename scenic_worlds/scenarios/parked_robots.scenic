"""Robots without work stand in rooms, before doors and on the lanes, where others have to pass.

Stresses parking: four of six robots are idle at the start, at sampled places, and must leave as
soon as one of the two that work wants the room they are in or the way they are on.
"""
from scenic_worlds.floors import hospital

param layout = hospital(
    shape='line',
    rooms=4,
    corridor_width=Range(2.2, 2.8),
    room_width=Range(6, 8),
    spots=2,
    station=False,
    parking=4,
)
model scenic_worlds.model

for i in range(2):
    new Robot with name f'robot{i + 1}', with start_room i
new Robot with name 'idle1', in near(2, 0.8)
new Robot with name 'idle2', in near(3, 0.8)
new Robot with name 'idle3', in queue_area(Uniform(2, 3)), with active Uniform(True, False)
new Robot with name 'idle4', in corridors

param horizon = 200
param tasks = [
    delivery(Range(0, 20), start, end, slack=(60, 130), robot=robot)
    for robot, start, end in [
        ('robot1', 0, 2), ('robot2', 1, 3), ('robot1', 2, Uniform(0, 1)), ('robot2', 3, Uniform(0, 2)),
    ]
]
