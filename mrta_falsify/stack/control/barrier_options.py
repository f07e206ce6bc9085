"""Options that all barrier controllers share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from mrta_falsify.core.codec import quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class CbfOptions:
    """Distances, gains and solver of a barrier controller; see docs/stack.md for reasons."""

    dynamics: str = "unicycle"  #: registered name of the robots' dynamics
    dynamics_options: dict[str, float] = field(default_factory=dict)
    solver: Literal["daqp", "osqp"] = "daqp"
    slack_weight: float = quantity(above=0.0, default=50.0)
    min_gap_robot: float = quantity(above=0.0, unit="m", default=0.6)  #: centre to centre
    min_gap_human: float = quantity(above=0.0, unit="m", default=0.6)  #: to a 0.25 m wide person
    min_gap_obstacle: float = quantity(above=0.0, unit="m", default=0.30)  #: centre to point
    body_radius: float = quantity(above=0.0, unit="m", default=0.24)  #: half the body's diagonal
    gains_robot: tuple[float, float] = (2.0, 5.0)  #: [1/s]
    gains_human: tuple[float, float] = (1.0, 2.0)  #: [1/s]
    gains_obstacle: tuple[float, float] = (2.0, 6.0)  #: [1/s]
    obstacle_memory: float = quantity(low=0.0, unit="s", default=3.0)  #: seen points are kept
    human_clearance: float = quantity(low=0.0, unit="m", default=0.12)  #: at rest before this gap
    human_stop: float = quantity(low=0.0, unit="m", default=0.2)  #: full stop, human approaches
    reaction_time: float = quantity(low=0.0, unit="s", default=0.1)  #: beyond one period
    braking_share: float = quantity(above=0.0, high=1.0, default=0.8)  #: of the acceleration limit
    reverse_speed: float = quantity(low=0.0, unit="m/s", default=0.25)
