"""The stack under test, from files and settings, and the map it sees."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from mrta_falsify.commands.folders import Place
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import LAYERS, StackConfig, apply_setting, read_config
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import CONNECT, EXEC, is_adapter, parse_stack
from mrta_falsify.core.world import World

#: a stack, its YAML file, ``default``, ``exec:CMD`` or ``connect:ADDRESS``
Stack = StackConfig | Place
SHIPPED = "default"  # name of the stack that is taken unless another one is named


def load_stack(
    stack: Stack | None = None, settings: Sequence[str] = (), *, where: str = "--stack"
) -> StackConfig:
    """Read a stack (the default one if None) and apply ``--set`` texts to it.

    Every layer's name and options are checked here, so that a mistake is reported with
    the file or option it stands in.

    Args:
        stack: a configuration, a YAML file, ``default``, or ``exec:CMD`` or ``connect:ADDRESS``
            for a foreign stack, or ``ADAPTER:TEXT`` of a registered adapter, such
            as ``ros_nodes:nodes.yaml``.
        settings: texts like ``planner=ompl``, ``planner.resolution=0.1``, ``defects=[name]``.
        where: option that names a foreign stack, for messages.

    Raises:
        InputError: unknown layer, implementation or option, or a value not allowed.
    """
    if isinstance(stack, StackConfig):
        config = stack
    elif stack is None or str(stack) == SHIPPED:
        config = StackConfig()
    elif is_process(str(stack)):
        config = StackConfig(stack=parse_stack(str(stack), where=where))
    else:
        config = read_config(Path(stack))
        check_stack(config, where=str(stack))
    for setting in settings:
        config = apply_setting(config, setting)
        check_stack(config, where=f"--set {setting}")
    return config


def is_process(stack: str) -> bool:
    """Whether a text names a foreign stack, not a file."""
    name, colon, _ = stack.partition(":")
    return stack.startswith((EXEC, CONNECT)) or (bool(colon) and is_adapter(name))


def load_other_stack(stack: Stack, tested: StackConfig) -> StackConfig:
    """Read the stack that another one is compared with.

    People and engine are not a stack's own: it gets those of the stack under test.

    Args:
        stack: as :func:`load_stack` takes it.
        tested: the stack under test.

    Raises:
        InputError: as of :func:`load_stack`, or both stacks are the same.
    """
    config = load_stack(stack, where="--against")
    config = dataclasses.replace(config, human_model=tested.human_model, engine=tested.engine)
    if config.digest() == tested.digest():
        raise ConfigError(
            "--against names the stack under test itself (engine and people aside); name another "
            "one, or change the stack under test by --stack or --set"
        )
    return config


def check_stack(config: StackConfig, *, where: str) -> None:
    """Refuse unknown implementations and options.

    Raises:
        InputError: the first one found, prefixed with ``where``.
    """
    for layer in LAYERS:
        choice = getattr(config, layer)
        component = registry.load(layer, choice.name, where=f"{where}: {layer}")
        codec.decode(component.Options, choice.options, where=f"{where}: {layer}")


def costmap_of(world: World, config: StackConfig | None = None) -> Costmap:
    """Build the costmap of ``world`` at time 0 as the stack sees it, planted defects included."""
    config = config or StackConfig()
    source = registry.build("costmap", config.costmap, defects=config.defects).bind(world)
    built: Costmap = source.costmap(0.0)
    return built
