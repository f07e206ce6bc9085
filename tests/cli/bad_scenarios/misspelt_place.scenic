model scenic_worlds.model
new Robot with start_room 0
new Bed on along_wal(1, fits=(1, 2))
param tasks = [(0, 0, 1, 200)]
