"""A shift in a warehouse: orders in waves, a picker on foot, pallets left in the aisles.

Stresses narrow aisles with traffic both ways: robots carry goods from pick faces to two
packing stations while a picker walks the aisles and pallets narrow them. Aisle widths, racks and
orders are sampled.
"""
from scenic_worlds.floors import warehouse

param layout = warehouse(
    aisles=4,
    picks=6,
    aisle_width=Range(2.4, 3.4),
    aisle_length=Range(10, 16),
    pick_offset=Range(0, 1),
    station_door=Range(1.2, 2),
)
model scenic_worlds.model

picks = [f'pick_{i}' for i in range(6)]
stations = ['station_0', 'station_1']

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room picks[i], with capacity 3

new Human with name 'picker', with route random_route(3), with speed Range(0.8, 1.4)
for i in range(2):
    new Pallet with name f'pallet{i + 1}', in corridors, facing Range(-20, 20) deg
new Crate with name 'crate1', in corridors, facing Range(0, 360) deg

param horizon = 300
param tasks = [
    delivery(wave + Range(0, 10), Uniform(*picks), Uniform(*stations), slack=(85, 150), service=5)
    for wave in [0, 0, 0, 30, 30, 30]
]
