"""How a bridge to DDS is set up: what a user writes into its YAML file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from mrta_falsify.core import codec
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import Coupling
from simulator_interface.foreign.robot_topics import Topics

MAX_DOMAINS = 101  # ROS 2's largest on Linux that meets no ephemeral port


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeSettings:
    """What a bridge does, and with whom."""

    coupling: Coupling = "stepped"
    #: programs with the user's nodes, each started for one episode; none: they run already
    commands: tuple[tuple[str, ...], ...] = ()
    domain: int | None = None  #: of DDS; None: one that no other bridge on the machine uses
    #: whether robots follow ``cmd_vel``, or the harness drives them to their ``goal_pose``
    drives: Literal["stack", "harness"] = "stack"
    says: tuple[Literal["deliveries", "goals", "paths"], ...] = ()
    topics: Topics = field(default_factory=Topics)
    done: tuple[str, ...] = ("/clock_done",)  #: stepped: on each the clock is acknowledged
    start_limit: float = quantity(above=0.0, unit="s", default=30.0)  #: until all have been found
    settle: float = quantity(low=0.0, unit="s", default=0.5)  #: without news, before the start
    step_limit: float = quantity(above=0.0, unit="s", default=8.0)  #: stepped: for one tick
    await_limit: float = quantity(above=0.0, unit="s", default=0.2)  #: awaited: for one tick
    rate: float = quantity(above=0.0, default=1.0)  #: paced: simulated seconds per second
    #: awaited: simulated time between two commands of a robot, 0: one every tick
    command_every: float = quantity(low=0.0, unit="s", default=0.0)
    #: simulated time after which a command counts no more, as in ros2_control's diff drive
    stale_after: float = quantity(above=0.0, unit="s", default=0.5)

    def __post_init__(self) -> None:
        if self.coupling == "stepped" and not self.done:
            raise ConfigError("done is empty; coupling `stepped` needs an acknowledgement topic")
        if self.domain is not None and not 0 <= self.domain <= MAX_DOMAINS:
            raise ConfigError(f"domain is {self.domain}; it must be from 0 to {MAX_DOMAINS}")
        if self.drives == "harness" and not self.topics.goal_pose:
            raise ConfigError("drives: harness needs the topic goal_pose; its name is empty")
        if self.drives == "stack" and not self.topics.cmd_vel:
            raise ConfigError("drives: stack needs the topic cmd_vel; its name is empty")


def read_settings(path: Path) -> BridgeSettings:
    """Read a YAML file.

    Raises:
        InputError: the file cannot be read, or a field is unknown or wrong.
    """
    data = codec.read_yaml(path)
    return codec.decode(BridgeSettings, {} if data is None else data, where=str(path))
