"""The smallest world that fails with no_robot_static_contact."""

param layout = localPath('world.min.layout.json')

model scenic_worlds.model

param horizon = 37.6
param noise_seed = 8514611595815388268

new Bed with name 'bed1',
    at (5.840817279774376, -0.07729180191861684, 0.475), facing 1.5707963267948966, with width 1, with length 2.2, with height 0.95,
    with mesh 'bed',
    with allowCollisions True, with regionContainedIn everywhere
new Bed with name 'bed2',
    at (10.254485754859742, -0.3570410872899368, 0.475), facing 1.5707963267948966, with width 1, with length 2.2, with height 0.95,
    with mesh 'bed',
    with allowCollisions True, with regionContainedIn everywhere

new Robot with name 'robot2',
    at (3.227306672199396, -4.05, 0.075), facing 0 deg,
    with max_speed 1.2551893305964767,
    with allowCollisions True, with regionContainedIn everywhere
new Robot with name 'robot4',
    at (14.569621042088388, -4.05, 0.075), facing 0 deg,
    with max_speed 0.8835862084291876,
    with allowCollisions True, with regionContainedIn everywhere

param tasks = [
    (3.1543961353600025, 3, 0, 118.91031516715884),
    (1.600511996075511, 2, 1, 92.52353983931243),
]
