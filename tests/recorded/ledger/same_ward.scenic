"""Two robots that share a short line of wards."""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.8, room_width=5,
                        spots=2, station=False, parking=2)
model scenic_worlds.model

new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 3

param horizon = 100
param tasks = burst(4, begin=Range(0, 5), within=20, slack=(60, 120), service=Range(0, 5))
