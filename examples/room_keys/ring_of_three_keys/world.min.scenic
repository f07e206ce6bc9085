"""The smallest world that fails with no_deadlock/3:no-path>no-path>no-path/room."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 129.8
param noise_seed = 2941620403797343574

new Robot with name 'robot1',
    at (2.625, 4.05, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere
new Robot with name 'robot2',
    at (3.375, -4.05, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere
new Robot with name 'robot3',
    at (8.625, 4.05, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (0, 1, 2, 284.45276867598295),
    (0, 4, 1, 247.50438960269094),
    (0, 2, 4, 281.87620198354125),
]
