model scenic_worlds.model
new Robot with start_room 0
new Chair with name 'first chair', at (0, 9, 0.5)
new Chair with name 'second chair', at (0.2, 9, 0.5)
param tasks = [(0, 0, 1, 200)]
