model scenic_worlds.model
new Bed in corridors
param tasks = [(0, 0, 1, 200)]
