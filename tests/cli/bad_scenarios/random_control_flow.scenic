model scenic_worlds.model
new Robot with start_room 0
count = DiscreteRange(1, 4)
for i in range(count):
    new Chair in corridors
param tasks = [(0, 0, 1, 200)]
