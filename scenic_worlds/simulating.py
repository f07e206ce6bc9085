"""The simulator of the model, loaded only when a program is simulated."""

from __future__ import annotations

import importlib
from typing import Any


def pybullet_simulator() -> Any:
    """Make a :class:`simulator_interface.scenic_bridge.simulator.PyBulletSimulator`.

    Sampling a program needs neither the physics engine nor the stack, so they are imported
    here and not with the model.
    """
    return importlib.import_module(
        "simulator_interface.scenic_bridge.simulator"
    ).PyBulletSimulator()
