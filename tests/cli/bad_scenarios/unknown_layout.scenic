param layout = 'aws_hospitl'
model scenic_worlds.model
new Robot with start_room 0
param tasks = [(0, 0, 1, 200)]
