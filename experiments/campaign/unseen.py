"""How often the interval covers the chance that another trial shows something new.

    python -m experiments.campaign.unseen [--campaigns 400]

Trials are drawn from laws that are known: situations independent of each other, or in groups that
come together, with chances that fall as a power of their rank. So the true chance that a further
trial shows a situation not seen yet is known for each campaign.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from mrta_falsify.campaigns.saturation import Saturation
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.seeding import stream

SITUATIONS = 300
TRIALS = (20, 60, 200)
POWERS = (0.8, 1.2, 2.0)
GROUPS = (1, 5)  # situations that always come together


def main() -> None:
    """Print a row for each law and length of a campaign."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=400)
    options = parser.parse_args()
    for power in POWERS:
        for group in GROUPS:
            for trials in TRIALS:
                row = coverage(power, group, trials, options.campaigns)
                print(json.dumps(row), flush=True)


def coverage(power: float, group: int, trials: int, campaigns: int) -> dict[str, float]:
    """Measure one law: share of campaigns whose interval covers the true chance."""
    chance = 0.9 * np.arange(1, SITUATIONS // group + 1, dtype=np.float64) ** -power
    covered, above, width, truths = 0, 0, 0.0, 0.0
    for number in range(campaigns):
        shown = stream(number, f"unseen/{power}/{group}/{trials}").random((trials, len(chance)))
        shows = shown < chance
        found = saturation_of(shows, group).unseen()
        truth = 1.0 - float(np.prod(1.0 - chance[~shows.any(axis=0)]))
        covered += found.low <= truth <= found.high
        above += truth > found.high
        width += found.high - found.low
        truths += truth
    return {
        "power": power,
        "group": group,
        "trials": trials,
        "true_chance": round(truths / campaigns, 3),
        "covered": round(covered / campaigns, 3),
        "above": round(above / campaigns, 3),
        "width": round(width / campaigns, 3),
    }


def saturation_of(shows: Array, group: int) -> Saturation:
    """Take in trials ``(t, g)`` of groups of situations."""
    saturation = Saturation()
    for row in shows:
        groups = np.flatnonzero(row).tolist()
        saturation.take([f"{one}.{part}" for one in groups for part in range(group)])
    return saturation


if __name__ == "__main__":
    main()
