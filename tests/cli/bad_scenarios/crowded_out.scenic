model scenic_worlds.model
new Robot with start_room 0
for i in range(2):
    new Bed with name f'bed_{i}', in CircularRegion((0, 9), 0.3)
param tasks = [(0, 0, 1, 200)]
