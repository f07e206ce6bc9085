# Failure family of trial 0003 of beds: no_deadlock/1:queue/queue of ward_southeast
#
# Runs fail in this way when
#   bed1.during[0] = 23.11 (not tried: out of runs)
#   bed1.during[1] = 53.39 (not tried: out of runs)
#   bed1.yaw = -87.1 (not tried: out of runs)
#   bed2.position.0 = 6.412 (not tried: out of runs)
#   bed2.position.1 = -22.87 (not tried: out of runs)
#   bed2.during[0] = 7.379 (not tried: out of runs)
#   bed2.during[1] = 13.07 (not tried: out of runs)
#   bed2.yaw = -66.04 (not tried: out of runs)
#   tasks[0][0] = 18.54 (not tried: out of runs)
#   tasks[1][0] = 7.229 (not tried: out of runs)
#   tasks[2][0] = 14.15 (not tried: out of runs)
#   tasks[3][0] = 1.352 (not tried: out of runs)
#   tasks[0][3] = 149.4 (not tried: out of runs)
#   tasks[1][3] = 92.06 (not tried: out of runs)
#   tasks[2][3] = 105 (not tried: out of runs)
#   tasks[3][3] = 128.3 (not tried: out of runs)
#
# 30 of 30 fresh samples of the family fail with this signature on the kinematic engine (95% interval 0.89 to 1.00); in the campaign it was 1 of 8 trials. 2 dimensions do not matter, 16 do.
#
# bed_in_the_doorway.scenic follows; its last lines restrict it to the family.

"""A bed stands in a doorway while robots want to go in and out.

Stresses blocked entrances: stretchers wait in the doorways of the two eastern wards of the AWS
hospital, at sampled places and angles, for a sampled time. Some leave a gap that a robot fits
through, some do not, and a robot may be on either side.
"""
model scenic_worlds.model

wards = ['ward_northeast', 'ward_southeast']

for i, start in enumerate(['ward_northeast', 'ward_southeast', 'day_surgery']):
    new Robot with name f'robot{i + 1}', with start_room start

for i, ward in enumerate(wards):
    start = Range(3, 30)
    new Blockage with name f'bed{i + 1}', in doorway(ward),
        with width 0.75, with length 2.05,
        facing Range(-130, -50) deg,
        with during (start, start + Range(10, 60))

param horizon = 240
param tasks = [
    delivery(Range(0, 20), start, end, slack=(90, 150))
    for start, end in [
        ('ward_northeast', 'day_surgery'), ('ward_southeast', 'ward_northeast'),
        ('day_surgery', 'ward_southeast'), ('ward_northeast', 'ward_southeast'),
    ]
]

param restrict = {  # share of each dimension's range
    'bed1.during[0]': (0.7446614821542553, 0.7446614821542553),  # bed1.during[0] = 23.11
    'bed1.during[1]': (0.8677901370764393, 0.8677901370764393),  # bed1.during[1] = 53.39
    'bed1.yaw': (0.536234988923975, 0.536234988923975),  # bed1.yaw = -87.1
    'bed2.position.0': (0.45363351396213747, 0.45363351396213747),  # bed2.position.0 = 6.412
    'bed2.position.1': (0.6311261458194174, 0.6311261458194174),  # bed2.position.1 = -22.87
    'bed2.during[0]': (0.16217009399436688, 0.16217009399436688),  # bed2.during[0] = 7.379
    'bed2.during[1]': (0.06135437612042827, 0.06135437612042827),  # bed2.during[1] = 13.07
    'bed2.yaw': (0.7994597009818593, 0.7994597009818593),  # bed2.yaw = -66.04
    'tasks[0][0]': (0.9271342581704252, 0.9271342581704252),  # tasks[0][0] = 18.54
    'tasks[1][0]': (0.3614378609514751, 0.3614378609514751),  # tasks[1][0] = 7.229
    'tasks[2][0]': (0.7075103187730077, 0.7075103187730077),  # tasks[2][0] = 14.15
    'tasks[3][0]': (0.06758848701632669, 0.06758848701632669),  # tasks[3][0] = 1.352
    'tasks[0][3]': (0.9902573165280304, 0.9902573165280304),  # tasks[0][3] = 149.4
    'tasks[1][3]': (0.034396951692543754, 0.034396951692543754),  # tasks[1][3] = 92.06
    'tasks[2][3]': (0.2492160038520559, 0.2492160038520559),  # tasks[2][3] = 105
    'tasks[3][3]': (0.6389240195768401, 0.6389240195768401),  # tasks[3][3] = 128.3
}
