"""The smallest world that fails with no_deadlock/1:stalled/ward_2."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 57.25
param noise_seed = 6375474604893067239

new Robot with name 'robot1',
    at (1.625, 4.05, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (0, 0, 2, 148.13449343666434),
    (0, 2, 4, 158.79281926900148),
]
