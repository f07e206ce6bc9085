"""The smallest world that fails with no_deadlock/1:wall/doorway."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 30.6
param noise_seed = 5539168172673808445

new Trolley with name 'trolley',
    at (7.006361384292681, 0.22338577932859005, 0.5), facing 2.1103777432421955, with width 0.6, with length 0.9, with height 1,
    with mesh 'trolley',
    with allowCollisions True, with regionContainedIn everywhere

new Robot with name 'robot1',
    at (2.125, 4.05, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (0, 2, 3, 92.15810932345678),
]
