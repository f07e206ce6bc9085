model scenic_worlds.model
new Robot with start_room 0
new Bed with name 'stray bed', at (100, 100, 0.5)
param tasks = [(0, 0, 1, 200)]
