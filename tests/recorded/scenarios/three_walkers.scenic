"""One robot has a delivery while three people walk the corridor, not all of whom look out.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=3.2, room_width=7,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

new Robot with name 'robot1', with start_room 0

for i in range(3):
    new Human with name f'walker{i + 1}', with route random_route(2),
        with phase Range(0, 1), with speed Range(0.5, 1.3),
        with reacts Discrete({True: 19, False: 1})

param horizon = 120
param tasks = [delivery(Range(0, 15), Uniform(0, 1), Uniform(2, 3), slack=(70, 100))]
