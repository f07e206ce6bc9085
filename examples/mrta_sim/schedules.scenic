"""MRTA-Sim's published case, first batch, without people: only the schedule of its nodes varies.

Six robots start in their rooms on the AWS hospital floor, and three tasks arrive at once. Searched
is what a real machine leaves to chance: when each process starts, and how long messages take.
"""
param layout = 'aws_hospital'
model scenic_worlds.model

for room in range(6):
    new Robot with name f'robot{room + 1}', with start_room room

param tasks = [(0, 1, 4, 200), (0, 2, 5, 200), (0, 5, 3, 250)]
param horizon = 60
param stack_params = (
    [('latency_most', Range(0, 0.005)), ('order', DiscreteRange(0, 1))]
    + [(f'phase.cbf_robot{robot}', Range(0, 0.05)) for robot in range(1, 7)]
    + [(f'phase.{name}', Range(0, 0.05))
       for name in ('goal_setter', 'room_queue', 'planner_wrapper')]
)
