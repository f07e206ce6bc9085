"""Does the interval of the failure probability cover what it should, and is it short?

    python -m benchmarks.campaign.coverage --campaigns 5000

Each campaign draws trials from a stand-in whose failure probability is known. The width is
compared with that of Clopper and Pearson (valid, wider) and with that of Wilson (shorter, but
not valid for every probability), for the same draws.
"""

from __future__ import annotations

import argparse
import json

import numpy as np
from scipy import stats

from mrta_falsify.campaign.statistics import blaker_interval
from mrta_falsify.core.seeding import stream


def coverage(p: float, trials: int, campaigns: int, seed: int) -> dict[str, float]:
    """Share of campaigns whose interval holds ``p``, and mean widths."""
    random = stream(seed, f"coverage/{p}/{trials}")
    failures = random.binomial(trials, p, size=campaigns)
    ends = {k: blaker_interval(int(k), trials) for k in np.unique(failures)}
    others = {}
    for k in ends:
        test = stats.binomtest(int(k), trials)
        for method in ("exact", "wilson"):
            interval = test.proportion_ci(method=method)
            others[method, k] = interval.high - interval.low
    covered = np.mean([ends[k][0] <= p <= ends[k][1] for k in failures])
    width = np.mean([ends[k][1] - ends[k][0] for k in failures])
    return {
        "p": p,
        "trials": trials,
        "coverage": float(covered),
        "monte_carlo_error": float(1.96 * np.sqrt(0.95 * 0.05 / campaigns)),
        "width": float(width),
        "width_over_clopper_pearson": float(
            width / np.mean([others["exact", k] for k in failures])
        ),
        "width_over_wilson": float(width / np.mean([others["wilson", k] for k in failures])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for trials in (50, 200, 1000):
        for p in (0.003, 0.02, 0.1, 0.3, 0.5):
            print(json.dumps(coverage(p, trials, arguments.campaigns, arguments.seed)))


if __name__ == "__main__":
    main()
