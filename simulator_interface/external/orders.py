"""What a stack in another process has ordered: twists, or where the harness drives its robots.

An order holds from when the stack has thought it out. Robots in `follow` keep to the path that they
were given, or are planned for, and the configured controller drives them.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Command, FleetState, Intent, StackEvent
from mrta_falsify.stack.comms import Links
from mrta_falsify.stack.following import Destination, Following, FollowState
from simulator_interface.external.answers import Answer, Wrong

ROUNDING = 1e-9  # s


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """What N robots are told to do."""

    twist: Array  #: (N, 3)
    intent: Intent  #: its goals and paths are where robots in ``follow`` are driven
    follow: frozenset[int] = frozenset()  #: robots that are driven for the stack

    def destinations(self) -> list[Destination | None]:
        """List where the robots in ``follow`` are to be driven."""
        return [
            Destination(goal, path) if robot in self.follow else None
            for robot, (goal, path) in enumerate(
                zip(self.intent.goal, self.intent.path, strict=True)
            )
        ]


@dataclass(slots=True)
class StandingOrders:
    """Memory of orders."""

    now: Order  #: in force
    follow: frozenset[int] = frozenset()  #: as said last
    coming: deque[tuple[float, Order]] = field(default_factory=deque)  #: from when [s] on
    driven: FollowState | None = None  #: None: no robot is driven


def no_orders(intent: Intent) -> StandingOrders:
    """Make the orders of N robots that stand, and whose stack intends nothing yet."""
    return StandingOrders(Order(np.zeros((len(intent.path), 3)), intent))


def take(
    orders: StandingOrders, answer: Answer, intent: Intent, time: float, names: Sequence[str]
) -> None:
    """Take in what the stack answered.

    Args:
        orders: memory; it is brought up to date.
        answer: of the stack.
        intent: as the stack says now.
        time: of the tick [s].
        names: of the robots.

    Raises:
        Wrong: a robot gets no twist and is not driven either.
    """
    follow = orders.follow if answer.follow is None else answer.follow
    twist = answer.twist
    if twist is None:
        left = [name for robot, name in enumerate(names) if robot not in follow]
        if left:
            raise Wrong("twist", f"is missing, and {left[0]} is not in `follow`")
        twist = np.zeros((len(names), 3))
    orders.follow = follow
    orders.coming.append((time + answer.took, Order(twist, intent, follow)))
    while orders.coming and orders.coming[0][0] <= time + ROUNDING:
        orders.now = orders.coming.popleft()[1]


def carry_out(
    orders: StandingOrders, following: Following, intent: Intent, fleet: FleetState, links: Links
) -> tuple[Command, Intent, list[StackEvent]]:
    """Turn the order in force into a command.

    Args:
        orders: memory; it is brought up to date.
        following: drives the robots in ``follow``.
        intent: as the stack says.
        fleet: what the robots' sensors say.
        links: of the robots.

    Returns:
        The command, the intent with the paths of the robots that are driven, and what happened
        to these.
    """
    order = orders.now
    if not order.follow:
        orders.driven = None
        return Command(twist=order.twist), intent, []
    orders.driven = orders.driven or following.start()
    result, events = following.step(orders.driven, order.destinations(), fleet, links)
    driven = sorted(order.follow)
    twist = order.twist.copy()
    twist[driven] = result.command.twist[driven]
    paths = list(intent.path)
    for robot in driven:
        paths[robot] = orders.driven.missions[robot].way.path
    intent = dataclasses.replace(
        intent,
        path=tuple(paths),
        cluster=result.cluster,
        leader=result.leader,
        slack=result.slack,
    )
    return Command(twist=twist), intent, [event for event in events if event.robot in driven]
