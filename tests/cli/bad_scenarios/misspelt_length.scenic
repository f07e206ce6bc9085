from scenic_worlds.floors import hospital
param layout = hospital(corridor_widht=Range(2.2, 3))
model scenic_worlds.model
new Robot with start_room 0
param tasks = [(0, 0, 1, 200)]
