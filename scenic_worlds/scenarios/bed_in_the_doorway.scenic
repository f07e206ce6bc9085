"""A bed stands in a doorway while robots want to go in and out.

Stresses blocked entrances: stretchers wait in the doorways of two wards of the AWS hospital, at
sampled places and angles, for a sampled time. Some leave a gap that a robot fits through, some do
not, and a robot may be on either side.
"""
model scenic_worlds.model

wards = ['ward_northeast', 'ward_southeast', 'ward_southwest', 'ward_northwest']

for i in range(4):
    new Robot with name f'robot{i + 1}', with start_room wards[i]

for i, ward in enumerate(['ward_northeast', 'ward_southwest']):
    start = Range(5, 60)
    new Blockage with name f'bed{i + 1}', in doorway(ward),
        with width 0.75, with length 2.05,
        facing Range(-40, 40) deg relative to (-90 if i == 0 else 90) deg,
        with during (start, start + Range(20, 90))

param horizon = 700
param tasks = [
    delivery(Range(0, 40), another_room(end), end, slack=(300, 450))
    for end in ['ward_northeast', 'ward_southwest', 'ward_northeast', 'ward_southwest']
] + [
    delivery(Range(0, 60), start, another_room(start), slack=(300, 450))
    for start in ['ward_northeast', 'ward_southwest']
]
