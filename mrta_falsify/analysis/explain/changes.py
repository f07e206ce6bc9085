"""Layers of a stack that can be exchanged, and for what."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import defect
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.specs.attribution import WHOLE

#: layers of the stack in the order of the pipeline; people and physics are not the stack's own
SUSPECTS = (
    "queue_policy",
    "waypoint_generator",
    "planner",
    "costmap",
    "priority_rule",
    "controller",
    "allocator",
)
#: alternatives that take minutes for a stream of tasks
LEFT_OUT = frozenset(("tsp", "exact"))
MAX_OTHERS = 2  # implementations of a layer that are tried in place of the one under test


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One layer that is exchanged."""

    layer: str
    text: str  #: in words
    config: StackConfig
    restores: bool = False  #: whether the shipped layer replaces another one


def changes_of(config: StackConfig) -> tuple[Change, ...]:
    """List the changes of each layer: to the shipped one, or from the shipped one to others.

    A foreign stack is replaced as a whole: by its own variants, by the shipped one.
    """
    if config.stack is not None:
        return tuple(_changes_of_whole(config, config.stack))
    return tuple(change for layer in SUSPECTS for change in _changes_of_layer(config, layer))


def _changes_of_whole(config: StackConfig, stack: ExternalStack) -> Iterator[Change]:
    for name, params in stack.variants.items():
        varied = dataclasses.replace(stack, params={**stack.params, **params})
        changed = dataclasses.replace(config, stack=varied)
        yield Change(layer=WHOLE, text=f"stack: its variant {name}", config=changed)
    text = "stack: the shipped one instead of the one under test"
    shipped = dataclasses.replace(config, stack=None)
    yield Change(layer=WHOLE, text=text, config=shipped, restores=True)


def _changes_of_layer(config: StackConfig, layer: str) -> Iterator[Change]:
    choice: Choice = getattr(config, layer)
    shipped: Choice = getattr(StackConfig(), layer)
    kept = tuple(name for name in config.defects if defect(name).layer != layer)
    if choice != shipped or kept != config.defects:
        text = f"{spaced(layer)}: the shipped {shipped.name} instead of the one under test"
        changed = dataclasses.replace(_with_layer(config, layer, shipped), defects=kept)
        yield Change(layer=layer, text=text, config=changed, restores=True)
        return
    others = (n for n in registry.names(layer) if n != choice.name and n not in LEFT_OUT)
    for name in itertools.islice(others, MAX_OTHERS):
        text = f"{spaced(layer)}: {name} instead of {choice.name}"
        yield Change(layer=layer, text=text, config=_with_layer(config, layer, Choice(name)))


def _with_layer(config: StackConfig, layer: str, choice: Choice) -> StackConfig:
    chosen: dict[str, Any] = {layer: choice}
    return dataclasses.replace(config, **chosen)


def spaced(layer: str) -> str:
    """Write a layer's name as words."""
    return layer.replace("_", " ")
