"""Does a candidate give the same world in a fresh process with another PYTHONHASHSEED?

Run: ``python benchmarks/scenic/reproducible.py [--programs 10] [--count 50]``

Each of the shipped programs realises ``count`` candidates here and again in a new process, from
the repaired coordinates as JSON; worlds are compared by digest. By default 10 x 50 = 500 worlds.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import warnings

import numpy as np

from mrta_falsify.core.candidate import Candidate
from scenic_worlds.program import compile_program
from scenic_worlds.shipped import scenario_names, scenario_path


def digests(name: str, candidates: list[Candidate], mode: str) -> tuple[list[str], list[Candidate]]:
    """World digests of candidates, and the candidates that give them by themselves."""
    program = compile_program(scenario_path(name))
    found = [program.realise(candidate, mode) for candidate in candidates]  # type: ignore[arg-type]
    return [entry.world.digest() for entry in found], [entry.candidate for entry in found]


def again(name: str, kind: str, text: str) -> None:
    """Print the digests of candidates given as JSON; what the fresh process does."""
    candidates = [
        Candidate(number=entry["number"], u=np.array(entry["u"]), seed=entry["seed"])
        for entry in json.loads(text)
    ]
    mode = "repair" if kind == "asked" else "exact"
    print(json.dumps(digests(name, candidates, mode)[0]))


def compare(name: str, count: int, hash_seed: int) -> int:
    """How many of ``count`` worlds of a program are equal in both processes, asked and repaired."""
    program = compile_program(scenario_path(name))
    asked = [program.candidate(17, number) for number in range(count)]
    here, repaired = digests(name, asked, "repair")
    same = np.ones(count, dtype=bool)
    for kind, candidates in (("asked", asked), ("repaired", repaired)):
        data = [{"number": c.number, "u": c.u.tolist(), "seed": c.seed} for c in candidates]
        done = subprocess.run(
            [sys.executable, "-W", "ignore", __file__, "--again", name, kind],
            env={**os.environ, "PYTHONHASHSEED": str(hash_seed)},
            input=json.dumps(data),
            capture_output=True,
            text=True,
            check=True,
        )
        there = json.loads(done.stdout.splitlines()[-1])
        same &= np.array([a == b for a, b in zip(here, there, strict=True)])
    return int(same.sum())


def main() -> None:
    """Print how many worlds agree."""
    if sys.argv[1:2] == ["--again"]:
        again(sys.argv[2], sys.argv[3], sys.stdin.read())
        return
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=10)
    parser.add_argument("--count", type=int, default=50)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    equal = total = 0
    for number, name in enumerate(scenario_names()[: arguments.programs]):
        same = compare(name, arguments.count, 1000 + number)
        equal, total = equal + same, total + arguments.count
        print(f"{name:24} {same} of {arguments.count}", flush=True)
    print(f"equal worlds: {equal} of {total}")


if __name__ == "__main__":
    main()
