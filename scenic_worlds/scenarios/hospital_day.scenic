"""A day on the AWS hospital floor: six robots, eight people, two bursts of deliveries.

Stresses nothing in particular: rooms, people's pace and a few pieces of furniture vary.
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
        with speed Range(0.6, 1.3), with reacts i >= 3

for i in range(3):
    new Trolley with name f'trolley{i + 1}', in corridors, facing Range(0, 360) deg

fetched_from = [any_room() for i in range(6)]
param tasks = [
    (0, room, another_room(room), Range(200, 300)) for room in fetched_from[:3]
] + [
    (Range(60, 180), room, another_room(room), Range(400, 600)) for room in fetched_from[3:]
]
