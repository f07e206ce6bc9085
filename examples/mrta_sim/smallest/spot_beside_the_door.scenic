"""robot2 is sent out of its room to the spot beside the door, in the way of robot1 who comes in."""
param layout = 'aws_hospital'
model scenic_worlds.model

new Robot with name 'robot1', with start_room 5
new Robot with name 'robot2', with start_room 4

param tasks = [(0, 5, 4, 60), (25, 4, 1, 69)]
param horizon = 70
param noise_seed = 6375474604893067239
