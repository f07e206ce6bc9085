"""robot1 and robot3 meet beside the mop cart between the cross corridors, as on the whole day."""
param layout = 'aws_hospital'
model scenic_worlds.model

new Robot with name 'robot1', at (7.9, -7.5), facing 180 deg
new Robot with name 'robot2', at (7.85, -21.8), facing 180 deg
new Robot with name 'robot3', at (-7.75, -7.5), facing 90 deg

param tasks = [(0, 1, 4, 200), (0, 2, 5, 200), (0, 5, 3, 250)]
param horizon = 40
param noise_seed = 0
