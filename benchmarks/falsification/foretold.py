"""How well the model of ``surrogate`` foretells a result from the others of its campaign.

    python -m benchmarks.falsification.foretold DIR [DIR ...]

DIR is a campaign, best of uniform draws (``suite rates``). Each margin and load of each trial is
foretold from all other trials; told is the mean correlation with what came, for the model without
coincidences, kinds of object and rehearsals, with each of them added, and as it is.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mrta_falsify.campaigns.runner import feedback_of
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.feedback import LOADS, Cube, Feedback, cube_of
from mrta_falsify.verbs.scene_rehearsal import SceneRehearsal
from mrta_falsify.verbs.stored_trials import open_campaign
from samplers.margin_models import NUGGET, Parts, likeliest, loads_of, margins_of
from samplers.rehearsals import Rehearsals, standardised
from samplers.scene_features import Features, as_coordinates


def correlations(
    cube: Cube, results: Sequence[Feedback], demands: Array | None = None, *, kinds: bool
) -> dict[str, float]:
    """Correlate each margin and load with what the other results foretell of it.

    Args:
        cube: that was searched.
        results: n of them.
        demands: of their scenes ``(n, m)``, scaled, where they are to be known.
        kinds: whether one kind of object alone may explain a margin.
    """
    points = np.array([result.u for result in results])
    if demands is not None:
        points = np.hstack([points, as_coordinates(demands)])
    features = Features(cube, demands=0 if demands is None else demands.shape[1])
    points = features.of(points)
    whole = Parts.between(points, points)
    of_kinds = [whole.only(kind, points, points) for kind in features.kinds if kinds]
    found = {}
    for margin in (*margins_of(results), *loads_of(results)):
        (model,) = likeliest(whole, of_kinds, [margin]).values()
        parts = whole if model.kind < 0 else of_kinds[model.kind]
        foretold = _left_out(model.kernel(parts), margin.values)
        found[margin.name] = float(np.corrcoef(foretold, margin.values)[0, 1])
    return found


def _left_out(kernel: Array, values: Array) -> Array:
    """Foretell each of n values from the others, ``(n,)``."""
    inverse = np.linalg.inv(kernel + NUGGET * np.eye(len(values)))
    return np.asarray(values - inverse @ values / np.diag(inverse))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directories", type=Path, nargs="+")
    rows = []
    for directory in parser.parse_args().directories:
        campaign = open_campaign(directory)
        cube = cube_of(campaign.settings.space)
        results = [
            feedback_of(record, cube, campaign.settings.trials.then)
            for record in campaign.records
            if record.status == "ok"
        ]
        rehearsals = Rehearsals(SceneRehearsal(campaign.settings.trials))
        demands = rehearsals.demands(result.u for result in results)
        models = {
            "plain": correlations(dataclasses.replace(cube, kin=()), results, kinds=False),
            "coincidences": correlations(cube, results, kinds=False),
            "and kinds": correlations(cube, results, kinds=True),
            "as it is": correlations(cube, results, standardised(demands, demands), kinds=True),
        }
        for name, of in models.items():
            loads = [value for of_what, value in of.items() if of_what in LOADS]
            margins = [value for of_what, value in of.items() if of_what not in LOADS]
            row = {"margins": float(np.mean(margins)), "loads": float(np.mean(loads or [np.nan]))}
            rows.append((name, row))
            print(json.dumps({"of": str(directory), "trials": len(results), "model": name, **row}))
    for name in dict.fromkeys(name for name, _ in rows):
        means = {
            what: float(np.nanmean([row[what] for of, row in rows if of == name]))
            for what in ("margins", "loads")
        }
        print(json.dumps({"of": "all", "model": name, **means}))


if __name__ == "__main__":
    main()
