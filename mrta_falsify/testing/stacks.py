"""Stacks for small tests: the shipped one on the kinematic engine, and weaker controllers."""

from __future__ import annotations

from typing import Any

from mrta_falsify.core.config import Choice, StackConfig

CONTROL_RATE = 10  # Hz: half the default's, and half the time
IN_TURN = Choice("in_turn")
#: leaders that never pass on the lead, followers that brake: MRTA-Sim's scheme
BRAKE = Choice("cluster_cbf", {"followers": "brake"})
SHARED = Choice("decentralised_cbf")  #: the lower-ranked robot gives way
SYMMETRIC = Choice("decentralised_cbf", {"share": 0.5})  #: nobody gives way
ALONE = Choice("cluster_cbf", {"neighbour_distance": 0.7})  #: leaders see robots that touch only


def stack(
    controller: Choice | None = None, *, defects: tuple[str, ...] = (), **layers: Any
) -> StackConfig:
    """Configure the shipped stack on the kinematic engine, at half its rate.

    Args:
        controller: in place of ``cluster_cbf``.
        defects: planted faults switched on.
        layers: other layers, by field of ``StackConfig``.
    """
    return StackConfig(
        engine=Choice("kinematic"),
        control_rate=CONTROL_RATE,
        controller=controller or Choice("cluster_cbf"),
        defects=tuple(sorted(defects)),
        **layers,
    )
