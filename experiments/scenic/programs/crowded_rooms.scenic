"""Furniture uniform in the rooms of a fixed floor, as densely as `pieces` says.

Ten wards of 6.5 x 5 m; a quarter each of beds, chairs, trolleys and cabinets, each anywhere in its
ward at any angle; six robots, eight people, twelve tasks.
"""
param pieces = 40
from scenic_worlds.floors import hospital
param layout = hospital(rooms=10, room_width=6.5, room_depth=5.0, station=False)
model scenic_worlds.model

for i in range(6):
    new Robot with start_room i

for i in range(int(globalParameters.pieces)):
    kind = [Bed, Chair, Trolley, Cabinet][i % 4]
    new kind in room(i % 10), facing Range(0, 360) deg

for i in range(8):
    new Human with route random_route(2), with speed Range(0.6, 1.4)

param tasks = [
    (Range(0, 60), any_room(), any_room(), Range(200, 400)) for _ in range(12)
]
