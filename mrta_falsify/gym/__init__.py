"""Episodes as PettingZoo environments: robots are agents, and a policy decides their twists.

``parallel_env`` needs the extra ``gym`` (pettingzoo, gymnasium), which is loaded when it is called.
What an observation holds is said in :mod:`mrta_falsify.stack.policy.observation`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.stacks import Stack
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.world import World
from mrta_falsify.stack.policy.observation import PARTS, SIZE

if TYPE_CHECKING:
    from mrta_falsify.gym.fleet_env import FleetEnv

__all__ = ["PARTS", "SIZE", "parallel_env"]


def parallel_env(
    source: World | Place,
    stack: Stack | None = None,
    *,
    settings: Sequence[str] = ("engine=kinematic",),
    specs: str | Sequence[str] = (),
    early_stop: bool = False,
) -> FleetEnv:
    """Make a PettingZoo ``ParallelEnv`` of the episodes of a world or a Scenic program.

    Args:
        source: a world, its file or shipped name; or a Scenic program, its file or shipped name.
        stack: allocates, queues and plans; its controller gives way to the actions.
        settings: ``--set`` texts applied to it.
        specs: what episodes are judged by; those of a campaign if empty.
        early_stop: end an episode soon after its first violation.

    Raises:
        ConfigError: the extra is not installed, or the stack is a process of its own.
        InputError: no such world or program, or it cannot be run.
    """
    try:
        from mrta_falsify.gym.fleet_env import FleetEnv  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        if error.name not in ("pettingzoo", "gymnasium"):
            raise
        raise ConfigError(
            f"{error.name} is not installed; run in the checkout: pip install '.[gym]'"
        ) from None
    return FleetEnv(source, stack, settings=settings, specs=specs, early_stop=early_stop)
