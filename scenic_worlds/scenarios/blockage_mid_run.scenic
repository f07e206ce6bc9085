"""Corridors that close while robots are in them, and open again.

Stresses planning anew: three beds are parked across the roads of the AWS hospital for a sampled
time, often in the only short way; sometimes a robot is caught between them.
"""
model scenic_worlds.model

for i in range(5):
    new Robot with name f'robot{i + 1}', with start_room i

for i, (start, end) in enumerate([(0, 2), (4, 0), (1, 5)]):
    begin = Range(10, 80)
    new Blockage with name f'bed{i + 1}', on route(start, end),
        with width 0.95, with length 2.1,
        facing Range(40, 140) deg relative to route(start, end).orientation,
        with during (begin, begin + Range(30, 150))

param horizon = 700
param tasks = (
    burst(3, within=30, start=0, slack=(260, 400)) + burst(3, within=30, end=0, slack=(260, 400))
)
