"""Does the interval of `--sampler splitting` cover a small probability that is known?

    python -m experiments.campaign.rare --campaigns 200

Whole campaigns of the sampler, asked and told as the runner does, over stand-ins in closed form:
a corner of the cube, two separate ways to fail, a score that the trial's own seed disturbs, a
score that is a staircase and flat where it is safe, and scenes that are rejected and replaced.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from mrta_falsify.campaigns.rare_events import rare_probability
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.feedback import Cube, Feedback
from mrta_falsify.core.seeding import candidate_seed, stream
from samplers.splitting import SplittingSampler

DIMENSIONS = 10
WINDOW = 8

#: margin to a violation at u ``(k,)``, with the trial's own seed, for probability p
Margin = Callable[[Array, int, float], float]


def tail(u: Array) -> float:
    """A standard normal number made of all coordinates."""
    return float(ndtri(np.clip(u, 1e-15, 1.0 - 1e-15)).sum() / np.sqrt(len(u)))


def corner(u: Array, seed: int, p: float) -> float:
    del seed
    return -float(ndtri(p)) - tail(u)


def two_ways(u: Array, seed: int, p: float) -> float:
    each = 1.0 - np.sqrt(1.0 - p)
    return min(corner(u[:5], seed, each), corner(u[5:], seed, each))


def disturbed(u: Array, seed: int, p: float) -> float:
    mixed = (2.0 * tail(u) + stream(seed, "own").normal()) / np.sqrt(5.0)
    return -float(ndtri(p)) - float(mixed)


def staircase(u: Array, seed: int, p: float) -> float:
    margin = corner(u, seed, p)
    return margin if margin < 0.0 else min(float(np.floor(2.0 * margin)) / 2.0, 2.0)


PROBLEMS: dict[str, Margin] = {
    "corner": corner,
    "two_ways": two_ways,
    "disturbed": disturbed,
    "staircase": staircase,
    "rejecting": corner,
}


@dataclass
class Found:
    estimate: float
    low: float
    high: float
    is_estimate: bool
    trials: int


def campaign(name: str, p: float, seed: int, sizes: dict[str, int]) -> Found:
    """One campaign until its first batch of runs is complete."""
    cube = Cube(dimensions=DIMENSIONS)
    sampler = SplittingSampler(SplittingSampler.Options(cube=cube, seed=seed, **sizes))
    waiting: list[tuple[int, Array]] = []
    trials = 0
    while not sampler.estimates().repeats:
        proposal = sampler.ask()
        waiting.append((proposal.number, proposal.u))
        if len(waiting) == WINDOW:
            number, u = waiting.pop(0)
            own = candidate_seed(seed, number)
            if name == "rejecting":
                draws = stream(own, "scene")
                while u[:2].max() > 0.7:  # half of the cube has no scene
                    u = draws.random(DIMENSIONS)
            inside = np.array([*u[:2] / 0.7, *u[2:]]) if name == "rejecting" else u
            margin = PROBLEMS[name](inside, own, p)
            sampler.tell(Feedback(number=number, u=u, score=margin, failed=margin < 0.0))
            trials += 1
    found = rare_probability(sampler.estimates())
    return Found(
        estimate=np.nan if found.estimate is None else found.estimate,
        low=found.low,
        high=found.high,
        is_estimate=found.method.startswith("splitting"),
        trials=trials,
    )


def measure(name: str, p: float, campaigns: int, sizes: dict[str, int]) -> dict[str, object]:
    """Coverage and width over many campaigns."""
    began = time.process_time()
    found = [campaign(name, p, seed, sizes) for seed in range(campaigns)]
    estimates = [f for f in found if f.is_estimate]
    means = np.array([f.estimate for f in estimates]) / p
    trials = float(np.mean([f.trials for f in found]))
    error = float(means.std()) if len(means) else float("nan")
    return {
        "problem": name,
        "p": p,
        "campaigns": campaigns,
        "coverage": float(np.mean([f.low <= p <= f.high for f in found])),
        "monte_carlo_error": round(float(1.96 * np.sqrt(0.95 * 0.05 / campaigns)), 4),
        "interval_below_p": float(np.mean([f.high < p for f in found])),
        "interval_above_p": float(np.mean([f.low > p for f in found])),
        "without_estimate": len(found) - len(estimates),
        "mean_estimate_over_p": round(float(means.mean()), 3) if len(means) else None,
        "its_error": round(error / np.sqrt(max(len(means), 1)), 3),
        "relative_error": round(error, 3),
        "median_high_over_low": round(
            float(np.median([f.high / f.low for f in estimates if f.low > 0.0])), 2
        ),
        "trials": round(trials),
        "independent_trials_for_this_error": round((1.0 - p) / p / error**2),
        "cpu_s": round(time.process_time() - began, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--p", type=float, action="append", help="default: 1e-3 and 1e-4")
    parser.add_argument("--problem", choices=PROBLEMS, action="append", help="default: all")
    parser.add_argument("--sizes", type=json.loads, default={}, help="options of the sampler")
    arguments = parser.parse_args()
    for p in arguments.p or (1e-3, 1e-4):
        for name in arguments.problem or PROBLEMS:
            print(json.dumps(measure(name, p, arguments.campaigns, arguments.sizes)), flush=True)


if __name__ == "__main__":
    main()
