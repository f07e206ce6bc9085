model scenic_worlds.model
new Robot with start_room 0
x = Range(0, 1)
if x > 0.5:
    new Chair in corridors
param tasks = [(0, 0, 1, 200)]
