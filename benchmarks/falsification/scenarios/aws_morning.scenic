"""Six robots fetch things from ward to ward of the AWS hospital while eight people walk about.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i

people = [
    [(-4, 11.1), (4, 11.1), (4, 2), (4, 11)],
    [(5, -8), (5, 1)],
    [(5, 1), (5, -9)],
    [(5, 13), (-5, 13)],
    [(10.5, 4.5), (4.5, 4.5), (0, 10), (4.5, 4.5)],
    [(5, -22.5), (5, 13.5)],
    [(5, -11.5), (5, -26)],
    [(5.5, 10.9), (-5.5, 10.9)],
]
for i in range(8):
    new Human with name f'human{i + 1}', with route people[i],
        with phase Range(0, 1), with speed Range(0.6, 1.3), with reacts i >= 3

for i in range(3):
    new Trolley with name f'trolley{i + 1}', in corridors, facing Range(0, 360) deg

param horizon = 150
param tasks = [delivery(Range(0, 15), i, another_room(i), slack=150) for i in range(6)]
