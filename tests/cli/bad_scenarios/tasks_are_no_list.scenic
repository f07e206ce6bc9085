model scenic_worlds.model
new Robot with start_room 0
param tasks = 5
