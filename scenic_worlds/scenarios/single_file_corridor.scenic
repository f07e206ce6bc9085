"""A corridor that only one or two robots may use at once, with deliveries from both ends.

Stresses corridors as resources: the length and the place of the stretch, how many robots it
takes, how it is given back and whether robots have spots to wait at are sampled. Each delivery
names its robot, so that robots meet from both sides at once.
"""
from scenic_worlds.floors import hospital

to_the_ends = [0.85, 0.15, 0.15, 0.85]
param layout = hospital(
    shape='line',
    rooms=4,
    corridor_width=Range(2.3, 2.8),
    room_width=9,
    door_offset=to_the_ends,
    spots=2,
    station=False,
    parking=2,
)
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i

middle, half = Range(8.6, 9.4), Range(0.6, 2.2)
new Corridor with name 'bottleneck', at (middle, 0), facing 90 deg,
    with width 3, with length 2 * half,
    with capacity Discrete({1: 3, 2: 1}),
    with hold Uniform('until_left', 'until_served'),
    with service_time Range(0, 4),
    with spots Uniform((), ((middle - half - 0.7, 0.8), (middle + half + 0.7, -0.8)))

param horizon = 200
param tasks = [
    delivery(Range(0, 10), start, end, slack=(120, 190), robot=f'robot{robot}')
    for robot, start, end in [
        (1, 0, Uniform(2, 3)), (2, 1, Uniform(2, 3)), (3, 2, Uniform(0, 1)), (4, 3, Uniform(0, 1)),
        (1, Uniform(2, 3), 0), (3, Uniform(0, 1), 2),
    ]
]
