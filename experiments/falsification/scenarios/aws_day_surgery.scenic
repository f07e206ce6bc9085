"""Three of six robots have something for the day surgery of the AWS hospital; eight people walk.

Scenario of the tuning set: see ../README.md before changing a line.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(8):
    new Human with name f'human{i + 1}', with route random_route(2),
        with speed Range(0.6, 1.3), with phase Range(0, 1)

param horizon = 150
param tasks = [
    delivery(Range(0, 20), start, 'day_surgery', slack=150, service=Range(0, 10))
    for start in [1, 2, 4]
]
