"""Visiting hour: people stream in from the entrance and go to the wards.

Stresses crowds that are not there at first: fourteen visitors of the AWS hospital appear at sampled
times in the entrance hall, walk to a sampled place in a room at their own pace, stay and leave;
robots come the other way.
"""
model scenic_worlds.model

entrance = RectangularRegion((0, 11), 0, 7, 4).intersect(free_floor)

for i in range(5):
    new Robot with name f'robot{i + 1}', with start_room i + 1

for i in range(14):
    arrival = Range(0, 45)
    new Human with name f'visitor{i + 1}',
        with route random_route(1, within=entrance) + random_visits(1),
        with repeat False,
        with speed Range(0.6, 1.4),
        with appears_at arrival,
        with leaves_at arrival + Range(120, 400)

param horizon = 600
param tasks = burst(5, within=60, start='nurses_station', slack=(200, 360)) + burst(
    5, within=60, end='nurses_station', slack=(200, 360)
)
