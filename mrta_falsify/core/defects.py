"""Planted defects: faults of published systems that can be switched on to test the search.

All are off by default. ``defects: [name]`` in the stack YAML switches them on; each layer
receives the names through the ``defects`` field of its ``Options``.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Defect:
    """One planted defect."""

    layer: str  #: layer that is to blame
    what: str  #: what goes wrong


DEFECTS: dict[str, Defect] = {
    "cluster_rows_wrong_robot": Defect(
        "controller", "barrier rows of a cluster use another robot's state"
    ),
    "follower_zero_command": Defect(
        "controller", "a follower's own zero command fights its leader's remote command"
    ),
    "queue_release_loses_exclusion": Defect(
        "queue_policy", "any release grants the room again, although another robot holds it"
    ),
    "room_freed_while_parked": Defect(
        "queue_policy", "a robot that finished frees the room while still parked in it"
    ),
    "same_room_twice_stalls": Defect(
        "waypoint_generator", "two consecutive stops in one room leave the robot without a way"
    ),
    "costmap_blind_to_furniture": Defect("costmap", "furniture is missing from the costmap"),
    "humans_unseen_beyond_two": Defect("controller", "only the first two humans are avoided"),
    "planner_failure_blocks_all": Defect(
        "planner", "one unreachable goal holds up the plans of all robots"
    ),
    "fourth_waiter_dropped": Defect("queue_policy", "the fourth robot in a queue is forgotten"),
    "fixed_priority_starves": Defect(
        "priority_rule", "a boxed-in leader keeps the lead, so its neighbours never move"
    ),
    "late_feedback_unsat": Defect(
        "allocator", "once a robot ends a committed stop late, no later batch has a plan"
    ),
    "no_plan_when_infeasible": Defect(
        "allocator", "no plan at all if one deadline cannot be met; the dispatcher stops for good"
    ),
}
