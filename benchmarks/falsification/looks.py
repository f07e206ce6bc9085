"""CPU time of a look: to draw, repair and rehearse a scene that may then not be run.

    python -m benchmarks.falsification.looks [PAIR ...] [--looks 200]

Pairs are of suite v2. A proposal of ``auto`` takes 60 to 80 looks.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from benchmarks.falsification.pairs import Pair, read_suite
from mrta_falsify.core.seeding import stream
from mrta_falsify.verbs.scene_rehearsal import SceneRehearsal

WARM = 20  # looks at first, which are not counted


def seconds_of_a_look(pair: Pair, looks: int) -> float:
    """Measure the CPU time of a look at scenes of even draws [s]."""
    with tempfile.TemporaryDirectory() as folder:
        settings = pair.searches(Path(folder), jittered=0)
        look = SceneRehearsal(settings.trials)
        points = stream(0, "looks").random((WARM + looks, settings.cube.dimensions))
        for u in points[:WARM]:
            look(u)
        began = time.process_time()
        for u in points[WARM:]:
            look(u)
        return (time.process_time() - began) / looks


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    suite = read_suite("v2")
    parser.add_argument("pairs", nargs="*", metavar="PAIR", default=list(suite))
    parser.add_argument("--looks", type=int, default=200)
    options = parser.parse_args()
    if unknown := set(options.pairs) - set(suite):
        parser.error(f"{', '.join(sorted(unknown))}: no such pair; there are {', '.join(suite)}")
    for name in options.pairs:
        print(f"{name:20} {1e3 * seconds_of_a_look(suite[name], options.looks):6.1f} ms")


if __name__ == "__main__":
    main()
