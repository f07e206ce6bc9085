"""Three robots on a short corridor with a cart somewhere in it: a trial of a second or two.

For benchmarks that need many trials of the real stack. The only floor plan is fixed, so that
worlds are made quickly; where the cart stands, when the tasks come and how fast the robots are
decides whether all is done in time.
"""
from scenic_worlds.floors import hospital

param layout = hospital(shape='line', rooms=4, corridor_width=2.0, station=False)
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i, with max_speed Range(0.6, 1.4)
new Trolley with name 'cart', in corridors, facing Range(0, 360) deg

param horizon = 60
param tasks = [
    delivery(Range(0, 6), 0, 3, slack=(40, 60)),
    delivery(Range(0, 6), 1, 2, slack=(40, 60)),
    delivery(Range(0, 6), 2, 0, slack=(40, 60)),
]
