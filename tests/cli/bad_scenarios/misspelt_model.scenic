model scenic_worlds.modle
new Robot with start_room 0
