"""Two robots, four deliveries between six rooms at nearly the same time.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=6, corridor_width=2.8, room_width=5,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 5

param horizon = 200
param tasks = burst(4, begin=Range(0, 5), within=20, slack=(90, 150), service=Range(0, 5))
