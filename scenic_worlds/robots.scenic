"""Robots."""

from scenic_worlds.floor import FloorObject, places
from scenic_worlds.random_places import point_of_room


class Robot(FloorObject):
    """A robot of the fleet, driven by the stack under test.

    It starts at the point of room `start_room`, or wherever a specifier puts it. The box is
    the disc of `body_radius` that planning keeps clear.

    Properties (units as in docs/world.md):
        start_room: room number or name.
        model: robot model of the engine, 'waffle' or 'burger', or a model file.
        body_radius, max_speed, max_acceleration, max_turn_rate, capacity.
        cruise_speed: on a straight way, up to max_speed.
        joins_at: takes no task before this time [s].
        position_noise [m], heading_noise [rad]: of localisation, standard deviations.
        wheel_slip: standard deviation of the relative loss of wheel speed.
        command_latency: from command to motion [s].
    """
    kind: 'robot'
    start_room: 0
    position: point_of_room(places, self.start_room, 0.075)
    width: 2 * self.body_radius
    length: 2 * self.body_radius
    height: 0.15
    model: 'waffle'
    body_radius: 0.22
    max_speed: 1.5
    cruise_speed: 0.75
    max_acceleration: 1.0
    max_turn_rate: 2.0
    capacity: 2
    joins_at: 0.0
    position_noise: 0.0
    heading_noise: 0.0
    wheel_slip: 0.0
    command_latency: 0.0
