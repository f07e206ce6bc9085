model scenic_worlds.model
new Robot with start_room 0
new Bed with name 'bed', in corridors, with width 'wide'
param tasks = [(0, 0, 1, 200)]
