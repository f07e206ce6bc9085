"""A policy made by hand: drive at the look-ahead point, slow down before what is ahead.

It needs nothing but numpy, so that it can be read beside a network that was trained.
"""

import numpy as np

from mrta_falsify.stack.policy.observation import PARTS

AHEAD = (11, 0, 1)  # sectors of 30 degrees: a little right, straight ahead, a little left
STOP, SLOW = 0.4, 1.0  # m from the robot's centre: stands, and begins to slow down
TURN_FIRST = 0.6  # rad off its way: turns on the spot
GIVE_WAY = 1.2  # m at which it makes room for a robot or person ahead
ASIDE = 0.6  # rad to the right, to make room


def act(observation: np.ndarray) -> np.ndarray:
    """Give forward speed and turn rate as shares of the largest, each in [-1, 1]."""
    part = {name: observation[place] for name, place in PARTS.items()}
    top_speed, _, top_rate, cruise = part["limits"]
    if not part["flags"][0]:
        return np.zeros(2)
    error = np.arctan2(part["target"][1], part["target"][0])
    bodies = [*part["robots"].reshape(-1, 5), *part["people"].reshape(-1, 6)]
    ahead = [body for body in bodies if body[-1] and body[0] > 0.0 and abs(body[1]) < 0.6]
    nearest = min((float(np.hypot(*body[:2])) for body in ahead), default=np.inf)
    if nearest < GIVE_WAY:
        error -= ASIDE
    room = min(nearest - 0.3, *(float(part["obstacles"][sector]) for sector in AHEAD))
    share = np.clip((room - STOP) / (SLOW - STOP), 0.0, 1.0)
    speed = 0.0 if abs(error) > TURN_FIRST else share * cruise
    return np.array([speed / top_speed, np.clip(2.0 * error / top_rate, -1.0, 1.0)])
