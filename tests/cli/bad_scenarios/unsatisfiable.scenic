model scenic_worlds.model
new Robot with start_room 0
bed = new Bed with name 'bed', in room(1)
chair = new Chair with name 'chair', in room(2)
require (distance from bed to chair) < 0.5 as 'chair beside bed'
param tasks = [(0, 0, 1, 200)]
