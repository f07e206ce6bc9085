"""Robots that slip, lag, mislocate themselves, or join late.

Stresses everything that assumes exact robots: localisation noise, wheel slip, command latency
and the time of joining are sampled for each robot, on the AWS hospital.
"""
model scenic_worlds.model

for i in range(5):
    new Robot with name f'robot{i + 1}', with start_room i,
        with position_noise Range(0, 0.08),
        with heading_noise Range(0, 0.1),
        with wheel_slip Range(0, 0.3),
        with command_latency Range(0, 0.4),
        with joins_at Range(0, 60)

param ray_noise = Range(0, 0.03)
param horizon = 700
param tasks = tight_deadlines(8, between=(0, 100), factor=(3, 5))
