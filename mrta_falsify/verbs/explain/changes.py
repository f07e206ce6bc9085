"""What a continuation does differently, and which layer is suspected from what came of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import DEFECTS
from mrta_falsify.core.findings import Counterfactual

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
#: alternatives that need an extra and take minutes for a stream of tasks
LEFT_OUT = frozenset(("smt", "tsp"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One layer that a continuation replaces."""

    layer: str
    text: str  #: in words
    config: StackConfig
    restores: bool = False  #: whether the shipped layer replaces another one


def changes_of(config: StackConfig) -> tuple[Change, ...]:
    """List the changes of each layer: to the shipped one, or from the shipped one to others."""
    return tuple(change for layer in SUSPECTS for change in _changes_of_layer(config, layer))


def _changes_of_layer(config: StackConfig, layer: str) -> Iterator[Change]:
    choice: Choice = getattr(config, layer)
    shipped: Choice = getattr(StackConfig(), layer)
    kept = tuple(name for name in config.defects if DEFECTS[name].layer != layer)
    if choice != shipped or kept != config.defects:
        text = f"{spaced(layer)}: the shipped {shipped.name} instead of the one under test"
        changed = dataclasses.replace(_with_layer(config, layer, shipped), defects=kept)
        yield Change(layer=layer, text=text, config=changed, restores=True)
        return
    for name in registry.names(layer):
        if name != choice.name and name not in LEFT_OUT:
            text = f"{spaced(layer)}: {name} instead of {choice.name}"
            yield Change(layer=layer, text=text, config=_with_layer(config, layer, Choice(name)))


def _with_layer(config: StackConfig, layer: str, choice: Choice) -> StackConfig:
    chosen: dict[str, Any] = {layer: choice}
    return dataclasses.replace(config, **chosen)


def spaced(layer: str) -> str:
    """Write a layer's name as words."""
    return layer.replace("_", " ")


class Suspicion(NamedTuple):
    """A suspected layer, and why."""

    layer: str
    reason: str


def suspicion_from(counterfactuals: Sequence[Counterfactual], guess: str) -> Suspicion:
    """Suspect a layer from what its changes did.

    A single layer whose change removes the failure is suspected. Of several, those count where
    the shipped layer replaced another one: a different implementation moves every robot
    differently, and may remove a failure by chance. Of these it is the one that the trace points
    to. Otherwise it is the first in the pipeline, since later layers act on what it gives them.

    Args:
        counterfactuals: of all changes.
        guess: the layer that the trace alone points to.
    """
    gone = [found for found in counterfactuals if found.failure_gone]
    restored = [found for found in gone if found.restores]
    cures = {found.layer for found in restored or gone}
    layers = [layer for layer in SUSPECTS if layer in cures]
    if not layers:
        reason = "no single change removes the failure; named by what the trace shows"
        return Suspicion(guess, reason)
    if restored and len(layers) == 1 and len({found.layer for found in gone}) > 1:
        return Suspicion(layers[0], "the shipped one in its place removes the failure")
    if len(layers) == 1:
        return Suspicion(layers[0], "changing it, and nothing else, removes the failure")
    named = f"changing any of {', '.join(map(spaced, layers))} removes the failure"
    if guess in layers:
        return Suspicion(guess, f"{named}; the trace points to this one")
    return Suspicion(layers[0], f"{named}; this one acts first")
