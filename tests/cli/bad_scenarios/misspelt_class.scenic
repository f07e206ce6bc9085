model scenic_worlds.model
new Robott with start_room 0
param tasks = [(0, 0, 1, 200)]
