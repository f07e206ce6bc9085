"""The smallest world that fails with no_deadlock/1:wall/open floor with furniture."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 50.5
param noise_seed = 332631556606384397

new Bed with name 'bed1',
    at (5.270181206264641, 0.13009646698959565, 0.475), facing 1.5707963267948966, with width 1, with length 2.2, with height 0.95,
    with mesh 'bed',
    with allowCollisions True, with regionContainedIn everywhere

new Robot with name 'robot1',
    at (2.875, 4.05, 0.075), facing 0 deg,
    with max_speed 1.1253595739278923,
    with allowCollisions True, with regionContainedIn everywhere
new Robot with name 'robot2',
    at (12.125, -4.05, 0.075), facing 0 deg,
    with max_speed 1.1507839884381221,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (1.0348416285994777, 0, 2, 74.14017353593353),
    (9.085966301979674, 3, 1, 78.95557596129419),
]
