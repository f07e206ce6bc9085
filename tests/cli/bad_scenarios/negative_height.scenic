model scenic_worlds.model
new Robot with start_room 0
new Chair with name 'flat chair', in corridors, with height -1
param tasks = [(0, 0, 1, 200)]
