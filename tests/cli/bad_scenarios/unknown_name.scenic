model scenic_worlds.model
new Robot with start_room 0
new Sofabed in corridors
param tasks = [(0, 0, 1, 200)]
