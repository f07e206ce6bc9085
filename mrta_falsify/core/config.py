"""Which implementation of each layer an episode uses, and with which options."""

from __future__ import annotations

import dataclasses
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.codec import later, quantity
from mrta_falsify.core.defects import check_defect
from mrta_falsify.core.errors import ConfigError, FormatError, UnknownNameError
from mrta_falsify.core.external import ExternalStack, bound_to, parse_stack
from mrta_falsify.core.fleet import Tells
from mrta_falsify.core.parsing import parse_yaml


@dataclass(frozen=True, slots=True)
class Choice:
    """One implementation by its registered name (or ``module:Class``), with its options."""

    name: str
    options: dict[str, Any] = dataclasses.field(default_factory=dict)


def default_engine() -> str:
    """Name the engine that judges unless another is chosen: PyBullet wherever it is installed.

    It has wheels for few machines; MuJoCo takes its place on the others.
    """
    return "bullet" if _is_importable("pybullet") else "mujoco"


def _is_importable(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ValueError:  # it is blocked
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class StackConfig:
    """The whole stack under test; YAML in and out."""

    allocator: Choice = Choice("insertion")
    queue_policy: Choice = Choice("fifo")
    priority_rule: Choice = Choice("fixed")
    waypoint_generator: Choice = Choice("roadways")
    planner: Choice = Choice("astar")
    costmap: Choice = Choice("layered")
    controller: Choice = Choice("cluster_cbf")
    human_model: Choice = Choice("by_sight")
    engine: Choice = Choice(default_engine())
    control_rate: int = quantity(low=5, high=100, unit="Hz", default=20)
    defects: tuple[str, ...] = ()  #: planted defects switched on, sorted
    withheld: tuple[str, ...] = later(())  #: fields of ``Tells`` kept from all observers, sorted
    stack: ExternalStack | None = later(None)  #: takes the place of all layers of the stack

    def __post_init__(self) -> None:
        for name in self.withheld:
            if name not in Tells._fields:
                raise UnknownNameError("part", name, Tells._fields, where="withheld")
        for name in self.defects:
            check_defect(name)

    def __repr__(self) -> str:
        """Write in one line what is not as shipped."""
        own = [
            f"{field.name}={value.name if isinstance(value, Choice) else value}"
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) != field.default
            and value != ()  # lists that name nothing
        ]
        return f"<StackConfig {', '.join(own) or 'as shipped'}>"

    def digest(self) -> str:
        """Compute the sha256 of the canonical JSON."""
        return codec.digest(self)

    def has(self, defect: str) -> bool:
        """Whether a planted defect is switched on."""
        return defect in self.defects


LAYERS: tuple[str, ...] = tuple(
    field.name for field in dataclasses.fields(StackConfig) if field.type == "Choice"
)
#: layers of the stack under test; people and physics are not the stack's own
STACK_LAYERS = tuple(layer for layer in LAYERS if layer not in ("human_model", "engine"))
#: tasks in, itineraries out, deliveries claimed: part of every stack, never exchanged
DISPATCHER = "dispatcher"
LISTS = ("defects", "withheld")  # fields that list names
STACK = "stack"  # field of a foreign stack


def decode_config(data: Any, *, where: str, folder: Path | None = None) -> StackConfig:
    """Read a stack configuration from YAML-shaped data.

    A layer is written as a name (``planner: astar``) or as a name with options
    (``planner: {name: astar, resolution: 0.1}``). A foreign stack is written as
    ``stack: exec:CMD``, ``stack: connect:ADDRESS`` or ``stack: {command: [...], ...}``.

    Args:
        data: of the YAML file.
        where: it stands, for messages.
        folder: paths in the stack's command are relative to it; None: they are bound already.

    Raises:
        ConfigError: unknown layer or ill-typed value.
    """
    if data is None:
        return StackConfig()
    if not isinstance(data, dict):
        raise ConfigError(f"{where}: is {type(data).__name__}; it must map layers to names")
    shaped: dict[str, Any] = {
        key: _shaped_layer(key, value, where) if key in LAYERS else value
        for key, value in data.items()
    }
    for field in LISTS:
        if isinstance(shaped.get(field), list):
            shaped[field] = sorted(set(map(str, shaped[field])))
    if isinstance(shaped.get(STACK), str):
        bound = parse_stack(shaped[STACK], where=f"{where}: stack", folder=folder)
        shaped[STACK] = codec.encode(bound)
    config = codec.decode(StackConfig, shaped, where=where)
    if config.stack is None or folder is None:
        return config
    bound = bound_to(config.stack, where=f"{where}: stack", folder=folder)
    return dataclasses.replace(config, stack=bound)


def _shaped_layer(layer: str, value: Any, where: str) -> dict[str, Any]:
    """Write a layer as an object with a name and options."""
    if isinstance(value, str):
        return {"name": value}
    if not isinstance(value, dict):
        raise ConfigError(
            f"{where}: {layer} is {codec.shown(value)}; it must be a name or an object"
        )
    if set(value) == {"name", "options"}:
        return value
    if isinstance(value.get("name"), str):
        options = {name: item for name, item in value.items() if name != "name"}
        return {"name": value["name"], "options": options}
    default: Choice = getattr(StackConfig(), layer)
    return {"name": default.name, "options": value}


def read_config(path: str | Path) -> StackConfig:
    """Read a stack configuration from a YAML file."""
    path = Path(path)
    return decode_config(codec.read_yaml(path), where=str(path), folder=path.parent)


def apply_setting(config: StackConfig, setting: str) -> StackConfig:
    """Apply one ``layer=name``, ``layer.option=value`` or ``defects=[a,b]`` to a copy.

    ``withheld=[deliveries]`` is set like ``defects``, ``stack=exec:CMD`` and ``stack.option=value``
    like a layer.

    Raises:
        ConfigError: the text is not of that form.
        UnknownNameError: no such layer.
    """
    where = f"--set {codec.named(setting)}"
    key, separator, text = setting.partition("=")
    if not separator or not key:
        raise ConfigError(f"{where}: it must read layer=NAME or layer.option=VALUE")
    try:
        value = parse_yaml(text, where)
    except FormatError as error:
        raise ConfigError(str(error)) from None
    layer, _, option = key.strip().partition(".")
    known = (*LAYERS, "control_rate", *LISTS, STACK)
    if layer not in known:
        raise UnknownNameError("layer", layer, known, where=where)
    data: dict[str, Any] = codec.encode(config)
    if option and layer in LAYERS:
        data[layer]["options"][option] = value
    elif option and layer == STACK:
        if config.stack is None:
            raise ConfigError(f"{where}: there is no foreign stack to set it for")
        data[STACK][option] = value
    elif option:
        raise ConfigError(f"{where}: {layer} has no options")
    elif layer in LAYERS:
        data[layer] = {"name": str(value), "options": {}}
    elif layer in LISTS:
        data[layer] = [value] if isinstance(value, str) else value
    else:
        data[layer] = value
    return decode_config(data, where=where)
