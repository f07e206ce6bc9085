"""The longest time for which the stack, or people, wait by a clock."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

from mrta_falsify.core import codec, registry
from mrta_falsify.core.allocation_problem import Stop
from mrta_falsify.core.config import LAYERS, Choice, StackConfig
from mrta_falsify.core.world import Task
from mrta_falsify.stack.dispatcher import LATE_FEEDBACK

PACKAGES = ("mrta_falsify", "simulator_interface")  #: whose layers' clocks are known
POLICY = "mrta_falsify.stack.policy"  #: layers that ask a policy of the user's
#: s; the clocks of the stack's own stages are shorter: ``dispatcher.REPLAN_PERIOD`` is the longest.
#: So is a person's patience on a route (``walking.STUCK_AFTER``)
LONGEST_OF_STAGES = 20.0
#: s that a person tries to reach or to push a piece of furniture (``pushing.APPROACH_LIMIT``)
LONGEST_OF_PUSHING = 100.0


def longest_timer(config: StackConfig, *, people: bool = True) -> float:
    """Find the longest time for which a layer of a stack may stand by a clock, at most [s].

    Args:
        config: of the stack.
        people: whether there are any, who move by its human model.

    Returns:
        The longest of the stages' clocks and of all options of the layers that are times. Infinity
        where a layer is not one of ours: nothing is known of its clocks.
    """
    if config.stack is not None:
        return math.inf
    layers = [layer for layer in LAYERS if people or layer != "human_model"]
    times = (_times_of(layer, getattr(config, layer)) for layer in layers)
    return max(LONGEST_OF_STAGES, *(time for found in times for time in found))


def looks_at_plan(plan: Sequence[Stop], tasks: Sequence[Task]) -> Iterator[float]:
    """Yield the moments at which the dispatcher plans anew, if the first stop stays undone [s].

    That is once it is late (``dispatcher.LATE_FEEDBACK``), and once a later drop will be.

    Args:
        plan: of a robot, one stop or more.
        tasks: of the world.
    """
    due = plan[0].time
    yield due + LATE_FEEDBACK
    for stop in plan[1:]:
        if stop.action == "dropoff":
            yield due + tasks[stop.task].deadline - stop.time


def _times_of(layer: str, choice: Choice) -> Iterator[float]:
    """Yield the options of a layer that are times [s]; infinity if it is not one of ours."""
    component = registry.load(layer, choice.name)
    module = component.__module__
    is_named = ":" in choice.name  # a class of the user's, or a process of its own
    if is_named or module.partition(".")[0] not in PACKAGES or module.startswith(POLICY):
        yield math.inf
        return
    options = codec.decode(component.Options, dict(choice.options), where=layer)
    for field in dataclasses.fields(options):
        rule = field.metadata.get("rule")
        value = getattr(options, field.name)
        if rule is not None and rule.unit == "s" and isinstance(value, (int, float)):
            yield float(value)
