model scenic_worlds.model
new Robot with start_room 0
new Bed in in corridors
param tasks = [(0, 0, 1, 200)]
