"""Three robots meet while radio links fail for a time.

Frozen scenario of the benchmark suite: see ../README.md before changing a line.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.2, room_width=6,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

for i, room in enumerate([0, 1, 3]):
    new Robot with name f'robot{i + 1}', with start_room room

for i in range(2):
    begin = Range(0, 30)
    new CommsOutage with name f'outage{i + 1}',
        with robots Uniform((), ('robot1',), ('robot2',), ('robot3',)),
        with links Uniform(('dispatcher',), ('planner',), ('states',), ('leader',)),
        with during (begin, begin + Range(5, 25))

param horizon = 150
param tasks = [
    delivery(Range(0, 10), 0, 3, slack=(74, 99)),
    delivery(Range(0, 10), 3, 0, slack=(74, 99)),
    delivery(Range(0, 10), 1, 2, slack=(74, 99)),
]
