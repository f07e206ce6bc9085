"""Everyone wants the same room.

Stresses the queue of one room: twelve deliveries go to the day surgery of the AWS hospital
within three minutes, with sampled service times, carried by seven robots.
"""
model scenic_worlds.model

for i in range(6):
    new Robot with name f'robot{i + 1}', with start_room i
new Robot with name 'robot7', in corridors

param horizon = 900
param tasks = hot_room(
    'day_surgery', 12, between=(0, 180), slack=(280, 480), share=0.9, service=Range(0, 20)
)
