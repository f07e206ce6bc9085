"""The smallest world that fails with no_deadlock/1:stalled/doorway."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 61.5
param noise_seed = 2399061064778190106

new Bed with name 'bed1',
    at (5.8323542983583865, 0.1365606529394705, 0.475), facing 1.5707963267948966, with width 1, with length 2.2, with height 0.95,
    with mesh 'bed',
    with allowCollisions True, with regionContainedIn everywhere

new Robot with name 'robot2',
    at (12.125, -4.05, 0.075), facing 0 deg,
    with max_speed 1.3524375779592273,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (0, 3, 1, 70.99393428827698),
]
