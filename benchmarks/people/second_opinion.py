"""The streams of :mod:`benchmarks.people.flows`, walked by JuPedSim as well.

    pip install jupedsim
    python -m benchmarks.people.second_opinion [--seeds N] [--densities D ...] [--widths W ...]

JuPedSim (Forschungszentrum Juelich, LGPL) simulates pedestrians for evacuation research. The same
people start at the same places, with the same speeds they wish for, and head for the same ends of
the same corridors. Its models keep their own parameters, but for the radius of 0.15 m: with a
larger one they refuse the starts that are nearest to each other.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

import jupedsim as jps
import numpy as np

from benchmarks.people.flows import (
    LENGTH,
    SETTLING,
    UNTIL,
    Flow,
    measured_flow,
    walkers,
)
from benchmarks.people.opinions import print_table, stream_arguments
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import HumanSpec

STEP = 0.01  # s, JuPedSim's own
LOOK = 50  # steps between two measurements, 0.5 s as in the worlds
RADIUS = 0.15  # m
BEYOND = 2.0  # m that the corridor goes on behind its ends


def speed_model(person: HumanSpec, place: Any) -> Any:
    """Collision-free speed model (Tordeux, Chraibi & Seyfried 2016)."""
    return jps.CollisionFreeSpeedModelV2AgentParameters(
        desired_speed=person.speed, radius=RADIUS, **place
    )


def anticipating(person: HumanSpec, place: Any) -> Any:
    """Anticipation velocity model (Xu, Chraibi & Seyfried 2021)."""
    return jps.AnticipationVelocityModelAgentParameters(
        desired_speed=person.speed, radius=RADIUS, **place
    )


MODELS: dict[str, tuple[Callable[[], Any], Callable[[HumanSpec, Any], Any]]] = {
    "collision-free speed": (jps.CollisionFreeSpeedModelV2, speed_model),
    "anticipation velocity": (lambda: jps.AnticipationVelocityModel(rng_seed=1), anticipating),
}


def seen_by(model: str, width: float, people: list[HumanSpec]) -> Iterator[tuple[Array, Array]]:
    """Walk people along a corridor; positions and velocities ``(h, 2)`` while they are measured."""
    half, side = LENGTH / 2.0 + BEYOND, width / 2.0
    make, parameters = MODELS[model]
    simulation = jps.Simulation(
        model=make(),
        geometry=[(-half, -side), (half, -side), (half, side), (-half, side)],
        dt=STEP,
    )
    stage = simulation.add_direct_steering_stage()
    journey = simulation.add_journey(jps.JourneyDescription([stage]))
    known = []
    for person in people:
        start, end = (tuple(map(float, point)) for point in person.route)
        place = {"position": start, "journey_id": journey, "stage_id": stage}
        known.append(simulation.add_agent(parameters(person, place)))
        simulation.agent(known[-1]).target = end
    before = _positions(simulation, known)
    for step in range(1, round(UNTIL / STEP) + 1):
        simulation.iterate()
        now = _positions(simulation, known)
        if step * STEP >= SETTLING and not step % LOOK:
            yield now, (now - before) / STEP
        before = now


def _positions(simulation: Any, known: list[int]) -> Array:
    return np.array([simulation.agent(agent).position for agent in known])


def theirs(density: float, width: float, model: str, *, both_ways: bool, seed: int) -> Flow:
    """Measure one stream of JuPedSim."""
    people = walkers(density, width, both_ways=both_ways, seed=seed)
    return measured_flow(density, width, people, seen_by(model, width, people))


def main() -> None:
    """Print the table."""
    models = {model: functools.partial(theirs, model=model) for model in MODELS}
    print_table(models, stream_arguments(__doc__).parse_args())


if __name__ == "__main__":
    main()
