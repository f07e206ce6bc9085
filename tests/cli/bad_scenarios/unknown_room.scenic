model scenic_worlds.model
new Robot with start_room 0
new Bed in room('ward_nroth')
param tasks = [(0, 0, 1, 200)]
