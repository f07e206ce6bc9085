"""The streams of :mod:`benchmarks.people.flows`, walked by JuPedSim as well.

    pip install jupedsim
    python -m benchmarks.people.second_opinion [--seeds N] [--densities D ...] [--widths W ...]

JuPedSim (Forschungszentrum Juelich, LGPL) simulates pedestrians for evacuation research. The same
people start at the same places, with the same speeds they wish for, and head for the same ends of
the same corridors. Its models keep their own parameters, but for the radius of 0.15 m: with a
larger one they refuse the starts that are nearest to each other.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from typing import Any

import jupedsim as jps
import numpy as np

from benchmarks.people.flows import (
    DENSITIES,
    LENGTH,
    SETTLING,
    UNTIL,
    Flow,
    measure,
    measured_flow,
    walkers,
    weidmann,
)
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
    """Print speed, share off Weidmann's curve, and share of people that touch, for each stream."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--densities", type=float, nargs="*", default=DENSITIES)
    parser.add_argument("--widths", type=float, nargs="*", default=(2.4, 3.6))
    options = parser.parse_args()
    print("| Stream | Corridor | Wanted [1/m2] | by_sight | " + " | ".join(MODELS) + " |")
    print("|---" * (4 + len(MODELS)) + "|")
    for both_ways in (False, True):
        for width in options.widths:
            for density in options.densities:
                cells = [
                    _cell([way(seed) for seed in range(options.seeds)])
                    for way in _ways(density, width, both_ways=both_ways)
                ]
                stream = "counterflow" if both_ways else "one way"
                print(
                    f"| {stream} | {width} m | {density} | " + " | ".join(cells) + " |", flush=True
                )


def _ways(density: float, width: float, *, both_ways: bool) -> list[Callable[[int], Flow]]:
    def by(measuring: Callable[..., Flow], model: str) -> Callable[[int], Flow]:
        return lambda seed: measuring(density, width, model, both_ways=both_ways, seed=seed)

    return [by(measure, "by_sight"), *(by(theirs, model) for model in MODELS)]


def _cell(flows: list[Flow]) -> str:
    at = float(np.mean([flow.density for flow in flows]))
    speed = float(np.mean([flow.speed for flow in flows]))
    share = float(np.mean([flow.touching for flow in flows]))
    return f"{speed:.2f} m/s at {at:.2f}, {speed / weidmann(at) - 1.0:+.0%}, {share:.0%}"


if __name__ == "__main__":
    main()
