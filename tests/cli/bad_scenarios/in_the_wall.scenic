model scenic_worlds.model
new Robot with start_room 0
new Bookshelf in along_wall(1)
param tasks = [(0, 0, 1, 200)]
