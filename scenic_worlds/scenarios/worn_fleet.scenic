"""Robots that slip, lag, mislocate themselves, or join late.

Stresses everything that assumes exact robots: localisation noise, wheel slip, command latency
and the time of joining are sampled for each robot, on the AWS hospital.
"""
model scenic_worlds.model

for i in range(3):
    new Robot with name f'robot{i + 1}', with start_room i + 1,
        with position_noise Range(0, 0.04),
        with heading_noise Range(0, 0.05),
        with wheel_slip Range(0, 0.2),
        with command_latency Range(0, 0.2),
        with joins_at Range(0, 15)

param ray_noise = Range(0, 0.03)
param horizon = 300
param tasks = [
    delivery(Range(0, 30), start, end, slack=(130, 210))
    for start, end in [(1, 2), (2, 3), (3, 1), (1, 3)]
]
