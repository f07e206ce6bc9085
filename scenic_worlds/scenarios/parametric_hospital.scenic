"""A hospital that is another one in each scene.

Stresses the layout: shape, corridor widths, room sizes, doors and the number of wards are
sampled, with furniture, people and a Poisson stream of tasks to match.
"""
from scenic_worlds.floors import hospital

WARDS = 6
param layout = hospital(
    shape=Uniform('ring', 'ell', 'comb'),
    rooms=WARDS,
    active=[True] * 4 + [Uniform(True, False) for _ in range(WARDS - 4)],
    corridor_width=Range(1.8, 3.2),
    cross_width=Range(1.8, 3.2),
    room_width=[Range(4.5, 7) for _ in range(WARDS)],
    room_depth=[Range(3.5, 5.5) for _ in range(WARDS)],
    door_width=[Range(0.8, 1.6) for _ in range(WARDS)],
    door_offset=[Range(0, 1) for _ in range(WARDS)],
    bathroom=[Range(0, 1) for _ in range(WARDS)],
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i

for i in range(3):
    new Bed with name f'bed{i + 1}', on along_wall(i + 1, fits=(1.0, 2.2))
new Trolley with name 'trolley1', in corridors, facing Range(0, 360) deg

for i in range(2):
    new Human with name f'walker{i + 1}', with route random_route(3), with speed Range(0.6, 1.3)
param horizon = 300
param tasks = burst(3, slack=(100, 180)) + poisson(
    1 / 15, between=(10, 60), most=4, slack=(100, 180)
)
