"""Visiting hour: people stream in from the entrance and go to the wards.

Stresses crowds that are not there at first: ten visitors of the AWS hospital appear at sampled
times in the entrance hall, walk to a sampled place in a room at their own pace, stay and leave;
robots come the other way.
"""
model scenic_worlds.model

entrance = RectangularRegion((0, 11), 0, 7, 4).intersect(free_floor)

for i, start in enumerate(['nurses_station', 'ward_northeast', 'ward_northwest']):
    new Robot with name f'robot{i + 1}', with start_room start

for i in range(10):
    arrival = Range(0, 30)
    new Human with name f'visitor{i + 1}',
        with route random_route(1, within=entrance) + random_visits(1),
        with repeat False,
        with speed Range(0.6, 1.4),
        with appears_at arrival,
        with leaves_at arrival + Range(60, 200)

param horizon = 240
param tasks = [
    delivery(Range(0, 30), start, end, slack=(70, 140))
    for start, end in [(0, 1), (1, 0), (0, 5), (5, 0), (1, 5)]
]
