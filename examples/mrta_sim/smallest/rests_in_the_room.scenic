"""robot2 has had no task and rests in the room to which robot1 delivers: two robots in a room."""
param layout = 'aws_hospital'
model scenic_worlds.model

new Robot with name 'robot1', with start_room 2
new Robot with name 'robot2', with start_room 3

param tasks = [(0, 2, 3, 25)]
param horizon = 30
param noise_seed = 6375474604893067239
