"""Does the interval of the failure probability cover what it should, and is it short?

    python -m benchmarks.campaign.coverage --campaigns 5000
    python -m benchmarks.campaign.coverage --real DIR --trials 20

Each campaign draws trials from a stand-in whose failure probability is known. The width is
compared with that of Clopper and Pearson (valid, wider) and with that of Wilson (shorter, but
not valid for every probability), for the same draws.

With ``--real`` the trials are those of a long campaign of `--sampler random --mode exact` on a real
scenario: each run of so many trials in a row is taken as a campaign of its own, and its interval
is held against the share of failures among all the others.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from scipy import stats

from mrta_falsify.campaigns.statistics import blaker_interval, why_no_probability
from mrta_falsify.core.seeding import stream
from mrta_falsify.verbs.stored_trials import open_campaign


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


def real_coverage(directory: Path, trials: int) -> dict[str, float]:
    """Coverage of short campaigns on a real scenario, cut from a long one."""
    campaign = open_campaign(directory)
    reason = why_no_probability(campaign.settings, any_uniform=True, stopped_early=False)
    if reason:
        raise SystemExit(f"{directory}: {reason}")
    failed = np.array([record.failed for record in campaign.records if record.status == "ok"])
    pieces = [failed[i : i + trials] for i in range(0, len(failed) - trials + 1, trials)]
    covered, widths = [], []
    for piece in pieces:
        low, high = blaker_interval(int(piece.sum()), trials)
        others = (failed.sum() - piece.sum()) / (len(failed) - trials)
        covered.append(low <= others <= high)
        widths.append(high - low)
    whole = blaker_interval(int(failed.sum()), len(failed))
    return {
        "long_run": len(failed),
        "failures": int(failed.sum()),
        "its_low": round(whole[0], 4),
        "its_high": round(whole[1], 4),
        "campaigns": len(pieces),
        "trials_each": trials,
        "coverage": float(np.mean(covered)),
        "mean_width": round(float(np.mean(widths)), 4),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--real", type=Path, help="directory of a long campaign")
    parser.add_argument("--trials", type=int, default=20, help="of a piece of it")
    arguments = parser.parse_args()
    if arguments.real:
        print(json.dumps(real_coverage(arguments.real, arguments.trials)))
        return
    for trials in (50, 200, 1000):
        for p in (0.003, 0.02, 0.1, 0.3, 0.5):
            print(json.dumps(coverage(p, trials, arguments.campaigns, arguments.seed)))


if __name__ == "__main__":
    main()
