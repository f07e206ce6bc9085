model scenic_worlds.model
new Robot with start_room 0
param task = [(0, 0, 1, 200)]
