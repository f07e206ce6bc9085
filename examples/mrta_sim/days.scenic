"""Days for MRTA-Sim's nodes: two batches of random tasks, two people, a schedule.

What its nodes can bear is kept to: six rooms, at most two people, a first batch at once.
"""
param layout = 'aws_hospital'
model scenic_worlds.model

for room in range(6):
    new Robot with name f'robot{room + 1}', with start_room room
for _ in range(2):
    new Human with route random_route(), with speed Range(0.6, 1.4)

starts = [any_room() for _ in range(6)]
first = [(0, start, another_room(start), Range(150, 300)) for start in starts[:3]]
second = [(90, start, another_room(start), Range(300, 600)) for start in starts[3:]]
param tasks = first + second
param horizon = 180
param stack_params = [('latency_most', Range(0, 0.005)), ('schedule', DiscreteRange(0, 999))]
