model scenic_worlds.model
new Robot with start_room 0
param tasks = [(0, 0, 1, 200), (Range(50, 60), 0, 1, 20)]
