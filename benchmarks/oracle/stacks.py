"""Stacks under test of the labelled set."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.config import Choice, StackConfig

CONTROL_RATE = 10  # Hz: half the default's, and half the time
IN_TURN = Choice("in_turn")
#: leaders that never pass on the lead, followers that brake: MRTA-Sim's scheme
BRAKE = Choice("cluster_cbf", {"followers": "brake"})
SHARED = Choice("decentralised_cbf")  #: the lower-ranked robot gives way
SYMMETRIC = Choice("decentralised_cbf", {"share": 0.5})  #: nobody gives way
ALONE = Choice("cluster_cbf", {"neighbour_distance": 0.7})  #: leaders see robots that touch only


def stack(
    controller: Choice | None = None, *, defects: tuple[str, ...] = (), **layers: Choice
) -> StackConfig:
    """The default stack on the kinematic engine, with the layers given."""
    return StackConfig(
        engine=Choice("kinematic"),
        control_rate=CONTROL_RATE,
        controller=controller or Choice("cluster_cbf"),
        defects=tuple(sorted(defects)),
        **layers,
    )


def any_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """One of the controllers; the default one most often."""
    pick = int(random.integers(8))
    if pick == 0:
        return stack(priority_rule=Choice("distance_to_goal"), **layers)
    return stack(
        (None, None, None, None, BRAKE, SHARED, SYMMETRIC, ALONE)[pick],
        **layers,
    )


def weak_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """One of the controllers that do not plan for others."""
    return stack((BRAKE, SHARED, SYMMETRIC, ALONE)[int(random.integers(4))], **layers)


def mixed_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """Mostly one of the controllers that do not plan for others: robots get stuck more often."""
    return (weak_stack if random.random() < 0.65 else any_stack)(random, **layers)
