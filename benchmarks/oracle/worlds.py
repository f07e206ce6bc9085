"""The labelled set: which runs there are.

Nothing here says which of them end in a deadlock: labels are made by continuation
(``labels.py``). Scripted kinds arrange a situation; sampled kinds arrange nothing and are
drawn more often, so that they are more than half of the set.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.oracle import held_up, pending, sampled, scripted
from benchmarks.oracle.sampled import Scene
from mrta_falsify.core import seeding
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import World

Maker = Callable[[np.random.Generator], Scene]

SCRIPTED: dict[str, Maker] = {
    "corridor_swap": scripted.corridor_swap,
    "corridor_many": scripted.corridor_many,
    "doorway": scripted.doorway,
    "niches": scripted.niches,
    "four_way": scripted.four_way,
    "slow": scripted.slow,
    "human": scripted.human,
    "no_task": scripted.no_task,
    "blocked": scripted.blocked,
    "outage": scripted.outage,
    "queue": scripted.queue,
    "queue_mouth": scripted.queue_mouth,
    "cork": scripted.cork,
    "room_exchange": scripted.room_exchange,
    "long_resource": scripted.long_resource,
    "plants": scripted.plants,
}
HELD_UP: dict[str, Maker] = {
    "creeping": held_up.creeping,
    "chain": held_up.chain,
    "ring_of_niches": held_up.ring_of_niches,
    "loop": held_up.loop,
}
PENDING: dict[str, Maker] = {
    "pending_service": pending.pending_service,
    "pending_opening": pending.pending_opening,
    "pending_person": pending.pending_person,
    "late_escape": pending.late_escape,
    "slow_arrival": pending.slow_arrival,
    "refuges": pending.refuges,
    "parked_in_file": pending.parked_in_file,
}
SAMPLED: dict[str, Maker] = {
    "sampled": sampled.sampled,
    "sampled_weak": sampled.sampled_weak,
    "sampled_planted": sampled.sampled_planted,
    "sampled_events": sampled.sampled_events,
    "maze": sampled.maze_default,
    "maze_weak": sampled.maze_weak,
    "maze_brake": sampled.maze_brake,
}
KINDS = SCRIPTED | HELD_UP | PENDING | SAMPLED
NO_DEADLINE = 1e5  # s; no deadline falls into a continuation, so all clocks there are short
#: cases of a kind for each case of the others: kinds in which robots do get stuck more often
WEIGHTS = {"niches": 2, "cork": 2, "blocked": 2}
WEIGHTS |= {"creeping": 2, "chain": 3, "late_escape": 3, "parked_in_file": 3}
WEIGHTS |= dict.fromkeys(SAMPLED, 2) | {"sampled_events": 5, "maze_weak": 4, "maze_brake": 6}


@dataclass(frozen=True)
class Case:
    """One run to label."""

    name: str
    kind: str
    world: World
    config: StackConfig


def cases(rounds: int = 5, kinds: tuple[str, ...] = (), first: int = 0) -> Iterator[str]:
    """Name ``rounds`` times ``WEIGHTS`` cases of each kind, kinds in turn.

    Args:
        rounds: how many.
        kinds: which; empty: all.
        first: seed of the first case of each kind; a case depends on kind and seed only.
    """
    for number in range(rounds):
        for kind in kinds or tuple(KINDS):
            weight = WEIGHTS.get(kind, 1)
            for k in range(weight):
                yield f"{kind}/{first + number * weight + k}"


def case_named(name: str) -> Case:
    """Make the case of a name: kind and seed, as ``niches/10003``."""
    kind, _, number = name.partition("/")
    return case(kind, int(number))


def case(kind: str, number: int) -> Case:
    """Make case ``number`` of ``kind``."""
    world, config = KINDS[kind](seeding.stream(number, f"oracle/{kind}"))
    tasks = sorted(world.tasks, key=lambda task: task.arrival)
    late = tuple(dataclasses.replace(task, deadline=NO_DEADLINE) for task in tasks)
    world = dataclasses.replace(world, seed=number, tasks=late)
    return Case(f"{kind}/{number}", kind, world, config)
