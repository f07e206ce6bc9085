"""Three deliveries between any rooms of the AWS hospital, shared out among six robots.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i, with cruise_speed Range(0.9, 1.3)

for i in range(8):
    new Human with name f'human{i + 1}', with route random_route(2), with speed Range(0.6, 1.3),
        with phase Range(0, 1)

param horizon = 150
param tasks = [
    delivery(Range(0, 25), start, another_room(start), slack=150)
    for start in [any_room() for _ in range(3)]
]
