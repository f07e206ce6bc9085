from scenic_worlds.robots import Robot
new Robot with start_room 0
param tasks = [(0, 0, 1, 200)]
