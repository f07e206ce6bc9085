"""The smallest world that fails with no_deadlock/1:cluster/doorway."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 42.25
param noise_seed = 5611424052063861358

new Robot with name 'robot1',
    at (7.9, -7.5, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere
new Robot with name 'robot2',
    at (7.85, -21.8, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere
new Robot with name 'robot3',
    at (4.25, -27.2, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere

new Blockage with name 'bed2',
    at (6.4118136223394195, -22.867310781270874, 0.475), facing -1.1526717060612057, with width 0.75, with length 2.05, with height 0.95,
    with during (7.378592537847906, 20.44631134386932)

param tasks = [
    (7.228757219029502, 2, 1, 99.29257432058213),
    (14.150206375460154, 3, 2, 119.10316660658351),
    (1.3517697403265339, 1, 2, 129.68721091493694),
]
