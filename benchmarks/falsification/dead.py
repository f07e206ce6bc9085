"""Dimensions over whose range no run changes: a search would look along them for nothing.

From a few base points each coordinate alone is moved over its range. It is alive once a trace
digest differs. The first seconds of a run are compared before the whole of it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.falsification.pairs import Pair
from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import World
from mrta_falsify.trial import Job, run_job
from scenic_worlds.program import Program, RejectedScene, compile_program

BASES = 4  # points from which a coordinate is moved
SOONEST = 20.0  # s of a run that are compared first
SPREAD = (0.02, 0.98, 0.5)  # values of a continuous coordinate


def dead(pairs: Iterable[Pair], options: argparse.Namespace) -> None:
    """Look at all dimensions of each pair; what is known is in DIR/dead."""
    for pair in pairs:
        path = options.directory / "dead" / f"{pair.name}.jsonl"
        path.parent.mkdir(parents=True, exist_ok=True)
        runs = _Runs(compile_program(pair.path), pair.stack)
        known = {row["dimension"]: row["alive"] for row in read_rows(path)}
        for i, dimension in enumerate(runs.program.space.dimensions):
            if dimension.name not in known:
                known[dimension.name] = runs.is_alive(i)
                append_row(path, {"dimension": dimension.name, "alive": known[dimension.name]})
        found = [name for name, alive in known.items() if not alive]
        row: dict[str, Any] = {"pair": pair.name, "k": len(known), "dead": found}
        print(json.dumps(row), flush=True)


@dataclass(slots=True)
class _Runs:
    """Runs of one pair, by their points and how long they are."""

    program: Program
    stack: StackConfig
    _digests: dict[tuple[bytes, float], str] = field(default_factory=dict)

    def is_alive(self, i: int) -> bool:
        """Whether moving coordinate ``i`` alone changes a run."""
        return any(
            self._digest(base, until) != self._digest(moved, until)
            for base in self._bases()
            for until in (SOONEST, np.inf)
            for moved in self._moved(base, i)
        )

    def _bases(self) -> Iterator[Array]:
        """Draw points with valid scenes."""
        for number in range(BASES):
            u = stream(number, "benchmarks/dead").random(len(self.program.space))
            asked = self.program.candidate(number)
            yield self.program.realise(dataclasses.replace(asked, u=u)).candidate.u

    def _moved(self, base: Array, i: int) -> Iterator[Array]:
        """Move coordinate ``i`` over its range, where the scene stays valid."""
        levels = self.program.space.dimensions[i].choices
        for value in (np.arange(levels) + 0.5) / levels if levels else SPREAD:
            u = np.array(base)
            u[i] = value
            if self._world(u) is not None:
                yield u

    def _world(self, u: Array) -> World | None:
        candidate = dataclasses.replace(self.program.candidate(0), u=u)
        try:
            return self.program.realise(candidate, "exact", max_attempts=1).world
        except RejectedScene:
            return None

    def _digest(self, u: Array, until: float) -> str:
        """Digest the trace of the first ``until`` seconds [s]."""
        key = (u.tobytes(), until)
        if key not in self._digests:
            world = self._world(u)
            assert world is not None, "only valid points are asked about"
            short = dataclasses.replace(world, horizon=min(until, world.horizon))
            job = Job(world=short, config=self.stack, specifications=("all_tasks_done",))
            self._digests[key] = run_job(job, keep_trace=False).trace.digest
        return self._digests[key]
