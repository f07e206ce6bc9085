model scenic_worlds.model
new Robot with start_room 0
new Human with name 'moonwalker', with route [(0, 9), (1, 9)], with speed Range(-2, -1)
param tasks = [(0, 0, 1, 200)]
