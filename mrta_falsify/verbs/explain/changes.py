"""What a continuation does differently, and which layer is suspected from what came of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mrta_falsify.campaigns.attribution import WHOLE, WORLD
from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import DEFECTS
from mrta_falsify.core.external import ExternalStack
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
    """List the changes of each layer: to the shipped one, or from the shipped one to others.

    A stack in a process of its own is replaced as a whole: by its own variants, by the shipped one.
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


def suspicion_from(
    counterfactuals: Sequence[Counterfactual],
    guess: str,
    *,
    direct: bool = False,
    knife_edge: bool = False,
) -> Suspicion:
    """Suspect a layer from what its changes did.

    A place that the world shut is of no layer. A stack in a process of its own is suspected as a
    whole. The rules, the first that applies:

    1. The shipped layer in place of another one removes the failure: that layer, the trace's own
       guess if there are several.
    2. The guess is a part of the stack that cannot be exchanged, or the violation itself names
       the layer: the guess. A change elsewhere may keep the run away from the situation.
    3. The guess is the costmap, of which there is one: the planner if another one on the same
       costmap removes the failure, else the costmap.
    4. The failure stands on a knife edge: the guess, since any change may remove it.
    5. Layers all of whose other implementations remove the failure, else those with one that
       does: of several the guess, since a failure that changes in different places remove proves
       little about any of them; the first in the pipeline if there is no guess.
    6. No change removes the failure: the guess. What all implementations of a layer share is
       not exchanged with it.

    Args:
        counterfactuals: of all changes.
        guess: the layer that the trace alone points to.
        direct: whether the violation itself names the layer.
        knife_edge: whether most copies with small differences pass.
    """
    if guess == WORLD:
        return Suspicion(WORLD, "the world shut a place during the run, no layer of the stack did")
    if guess == WHOLE:
        return Suspicion(WHOLE, _of_whole(counterfactuals))
    restored = _cures([found for found in counterfactuals if found.restores])
    if restored:
        return _chosen(restored, guess, "the shipped one in its place removes the failure")
    if guess and guess not in SUSPECTS:
        return Suspicion(guess, "named by what the trace shows; it has no other implementation")
    if guess and direct:
        return Suspicion(guess, "named by the violation itself")
    cures = _cures(counterfactuals)
    if guess == "costmap" and any(found.layer == "planner" for found in counterfactuals):
        if any(found.layer == "planner" and found.failure_gone for found in counterfactuals):
            return Suspicion("planner", "another planner on the same costmap removes the failure")
        return Suspicion(guess, "another planner on the same costmap fails in the same way")
    if not cures:
        reason = "no single change removes the failure; named by what the trace shows"
        return Suspicion(guess, reason)
    if guess and knife_edge:
        reason = "a knife edge, which many changes remove; named by what the trace shows"
        return Suspicion(guess, reason)
    if guess and len(cures) > 1:
        return Suspicion(guess, f"{_any_of(cures)}; the trace points to this one")
    return _chosen(cures, guess, "changing it, and nothing else, removes the failure")


def _of_whole(counterfactuals: Sequence[Counterfactual]) -> str:
    """Say what a stack without known layers has to do with a failure."""
    if any(found.restores and found.failure_gone for found in counterfactuals):
        return "the shipped stack does not fail in this world"
    if any(found.failure_gone for found in counterfactuals):
        return "one of its own variants does not fail in this world"
    shipped = [found for found in counterfactuals if found.restores]
    if any(found.answered for found in shipped):
        return "the shipped stack violates the same specification in this world"
    why = f": {shipped[0].detail}" if shipped else ""
    return f"whether the shipped stack fails in this world is not known{why}"


def _cures(counterfactuals: Sequence[Counterfactual]) -> list[str]:
    """List the layers whose change removes the failure, those of which every change does first."""
    some = {found.layer for found in counterfactuals if found.failure_gone}
    every = some - {found.layer for found in counterfactuals if not found.failure_gone}
    return [layer for layer in SUSPECTS if layer in (every or some)]


def _chosen(layers: Sequence[str], guess: str, alone: str) -> Suspicion:
    """Choose one of ``layers``; ``alone`` is the reason if it is the only one."""
    if len(layers) == 1:
        return Suspicion(layers[0], alone)
    if guess in layers:
        return Suspicion(guess, f"{_any_of(layers)}; the trace points to this one")
    return Suspicion(layers[0], f"{_any_of(layers)}; this one acts first")


def _any_of(layers: Sequence[str]) -> str:
    return f"changing any of {', '.join(map(spaced, layers))} removes the failure"
