"""The labelled set: which runs there are.

Nothing here says which of them end in a deadlock: labels are made by continuation
(``labels.py``). Most kinds arrange a situation; sampled kinds arrange nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from experiments.oracle import freed, held_up, locked, pending, sampled, scripted, shut, timed
from experiments.oracle.sampled import Scene
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
TIMED: dict[str, Maker] = {
    "timer_hall": timed.timer_hall,
    "timer_file": timed.timer_file,
    "person_waits": timed.person_waits,
}
LOCKED: dict[str, Maker] = {"lock_hall": locked.lock_hall, "lock_lane": locked.lock_lane}
SHUT: dict[str, Maker] = {
    "bed_shuts": shut.bed_shuts,
    "bed_shuts_outside": shut.bed_shuts_outside,
}
FREED: dict[str, Maker] = {
    "arrival_frees": freed.arrival_frees,
    "arrival_frees_outside": freed.arrival_frees_outside,
    "opening_outside": freed.opening_outside,
    "lane_pair": freed.lane_pair,
}
KINDS = SCRIPTED | HELD_UP | PENDING | SAMPLED | TIMED | LOCKED | SHUT | FREED
SHIPPED, COPIED, NOT_COPIED = "shipped", "outside", "outside_not_copied"
NO_DEADLINE = 1e5  # s; no deadline falls into a continuation, so all clocks there are short
#: cases of each kind in a round. About half of a round ends in a deadlock, and costs little.
ROUND = {
    **{"lock_hall": 4, "lock_lane": 3, "timer_hall": 3, "timer_file": 2, "lane_pair": 3},
    **{"bed_shuts_outside": 2, "arrival_frees_outside": 1, "opening_outside": 1},
    **{"bed_shuts": 2, "arrival_frees": 2, "person_waits": 1, "late_escape": 3},
    **{"pending_opening": 1, "pending_service": 1, "parked_in_file": 1, "refuges": 1},
    **{"corridor_swap": 1, "niches": 2, "cork": 1, "four_way": 1, "doorway": 1},
    **{"creeping": 1, "chain": 2, "ring_of_niches": 1, "loop": 1},
    **{"maze": 1, "maze_weak": 1, "maze_brake": 2, "sampled_events": 1, "sampled_weak": 1},
}


@dataclass(frozen=True)
class Case:
    """One run to label."""

    name: str
    kind: str
    world: World
    config: StackConfig

    @property
    def group(self) -> str:
        """Whose stack it is, and whether the run can be copied."""
        if self.config.stack is None:
            return SHIPPED
        return NOT_COPIED if self.config.stack.branch == "never" else COPIED


def cases(rounds: int = 5, kinds: tuple[str, ...] = (), first: int = 0) -> Iterator[str]:
    """Name ``rounds`` times the cases of a round, kinds in turn.

    Args:
        rounds: how many.
        kinds: which; empty: those of ``ROUND``.
        first: seed of the first case of each kind; a case depends on kind and seed only.
    """
    for number in range(rounds):
        for kind in kinds or tuple(ROUND):
            weight = ROUND.get(kind, 1)
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
