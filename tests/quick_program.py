"""A program whose trials take half a second, and now and then miss a deadline."""

PROGRAM = """
model scenic_worlds.model
new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 1
new Trolley in corridors
param tasks = [
    (0, 0, DiscreteRange(2, 5), Range(12, 60)),
    (Range(0, 10), 1, DiscreteRange(2, 5), Range(18, 70)),
]
param horizon = 35
"""
