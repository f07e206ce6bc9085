param layout = localPath('cut_off.yaml')
model scenic_worlds.model
new Robot with start_room 'lab'
param tasks = [(0, 'lab', 'store', 200)]
