"""Corridors that close while robots are in them, and open again.

Stresses planning anew: three beds are parked across the roads in the north of the AWS hospital
for a sampled time, often in the only short way; sometimes a robot is caught between them.
"""
model scenic_worlds.model

for i, start in enumerate(['nurses_station', 'ward_northeast', 'ward_northwest']):
    new Robot with name f'robot{i + 1}', with start_room start

for i, (start, end) in enumerate([(0, 1), (5, 0), (1, 5)]):
    begin = Range(2, 40)
    new Blockage with name f'bed{i + 1}', on route(start, end),
        with width 0.95, with length 2.1,
        facing Range(40, 140) deg relative to route(start, end).orientation,
        with during (begin, begin + Range(10, 60))

param horizon = 240
param tasks = [
    delivery(Range(0, 20), start, end, slack=(95, 155))
    for start, end in [(0, 1), (1, 5), (5, 0), (1, 0), (5, 1)]
]
