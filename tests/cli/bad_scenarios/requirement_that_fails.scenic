model scenic_worlds.model
new Robot with start_room 0
bed = new Bed with name 'bed', in corridors
require bed.position.x / 0 > 1
param tasks = [(0, 0, 1, 200)]
