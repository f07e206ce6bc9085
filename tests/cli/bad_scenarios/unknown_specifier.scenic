model scenic_worlds.model
new Robot with start_room 0
bed = new Bed in corridors
new Chair at bed.positon
param tasks = [(0, 0, 1, 200)]
