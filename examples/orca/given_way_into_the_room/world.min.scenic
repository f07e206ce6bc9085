"""The smallest world that fails with exclusive_use."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 85.9
param noise_seed = 3356563006536239345

new Robot with name 'robot2',
    at (3.875, -4.05, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere
new Robot with name 'robot3',
    at (8.125, 4.05, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (0, 3, 0, 79.99996405094862),
    (0, 3, 2, 81.73800015822053),
]
