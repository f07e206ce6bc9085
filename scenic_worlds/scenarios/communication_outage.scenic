"""Radio links fail for a time, one kind or another, for one robot or all.

Stresses what robots do alone: each outage cuts a sampled link of sampled robots while they
meet in the corridors of the AWS hospital.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i, with position_noise 0.01

for i in range(4):
    begin = Range(5, 120)
    new CommsOutage with name f'outage{i + 1}',
        with robots Uniform((), ('robot1',), ('robot2', 'robot3'), ('robot4', 'robot5')),
        with links Uniform(('dispatcher',), ('planner',), ('states',), ('leader',),
                           ('planner', 'states')),
        with during (begin, begin + Range(20, 90))

param horizon = 700
param tasks = burst(6, within=20, slack=(180, 320)) + burst(4, begin=60, within=30, slack=(180, 320))
