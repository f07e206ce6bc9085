"""From how many places with its nose at a door post does a robot not get away?

    python -m benchmarks.control.door_posts [--controller cluster_cbf] [--engine kinematic]

One robot has to fetch something behind the door. Its nose is 0.1 m from what it points at, beside
the post; varied are the door's width, the post, the heading and the point.
"""

from __future__ import annotations

import argparse
import itertools

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.trial import Job, judge
from tests.scenes.test_door_post import at_the_post

DOORS = (0.9, 1.0, 1.2)  # m
HEADINGS = (45, 60, 75, 90, 105, 120, 135)  # degrees, 90: straight at the wall
BESIDE = (-0.1, 0.0, 0.08)  # m
SPECIFICATIONS = ("no_deadlock", "all_tasks_done", "no_robot_static_contact")


def violated(
    config: StackConfig, door: float, side: int, heading: float, beside: float
) -> list[str]:
    """List what is violated from one place; empty if the robot gets away and does its work."""
    world = at_the_post(door, side, heading, beside)
    job = Job(world=world, config=config, specifications=SPECIFICATIONS, early_stop=True)
    return [verdict.spec for verdict in judge(job, keep_trace=False).verdicts if verdict.violated]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--controller", default="cluster_cbf")
    parser.add_argument("--engine", default="kinematic")
    args = parser.parse_args()
    config = StackConfig(engine=Choice(args.engine), controller=Choice(args.controller))
    for door in DOORS:
        places = list(itertools.product((-1, 1), HEADINGS, BESIDE))
        found = [violated(config, door, *place) for place in places]
        stuck = [place for place, names in zip(places, found, strict=True) if names]
        print(f"door {door} m: {len(stuck)} of {len(places)} stuck {stuck}", flush=True)


if __name__ == "__main__":
    main()
