"""The smallest world that fails with no_deadlock/1:stalled/room."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 105.5
param noise_seed = 6375474604893067239

new Robot with name 'robot3',
    at (4.25, -27.2, 0.075), facing 0 deg,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (0, 3, 4, 171.4068483542651),
    (0, 4, 5, 190.75636851973832),
]
