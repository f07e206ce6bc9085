"""Radio links fail for a time, one kind or another, for one robot or all.

Stresses what robots do alone: each outage cuts a sampled link of sampled robots while they
meet in the corridors of the AWS hospital.
"""
model scenic_worlds.model

for i in range(5):
    new Robot with name f'robot{i + 1}', with start_room i + 1, with position_noise 0.01

for i in range(4):
    begin = Range(2, 50)
    new CommsOutage with name f'outage{i + 1}',
        with robots Uniform((), ('robot1',), ('robot2', 'robot3'), ('robot4', 'robot5')),
        with links Uniform(('dispatcher',), ('planner',), ('states',), ('leader',),
                           ('planner', 'states')),
        with during (begin, begin + Range(10, 45))

param horizon = 300
param tasks = [
    delivery(Range(0, 25), start, end, slack=(115, 195))
    for start, end in [(1, 2), (2, 3), (3, 4), (4, 2), (2, 1), (3, 1)]
]
