model scenic_worlds.model
new Robot with start_room 0
require 1 > 2
param tasks = [(0, 0, 1, 200)]
