"""Eight deliveries at once for four robots.

Stresses allocation and the queues that follow from it: the tasks arrive within seconds,
between any rooms of the AWS hospital, with deadlines that a good plan meets and a bad one does
not.
"""
model scenic_worlds.model

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room i + 1, with capacity DiscreteRange(1, 3)

param horizon = 300
param tasks = burst(8, begin=Range(0, 10), within=5, slack=(112, 200), service=Range(0, 5))
