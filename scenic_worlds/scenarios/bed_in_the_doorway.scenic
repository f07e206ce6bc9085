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
