model scenic_worlds.model
new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 0
param tasks = [(0, 0, 1, 200)]
