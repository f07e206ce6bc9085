"""How often does a random world of each shipped program make the default stack fail, and how?

Run: ``nice python -m benchmarks.scenic.difficulty [PROGRAM ...] [--trials 20] [--json FILE]``

The trials are those of ``mrta-falsify campaign PROGRAM --sampler random --budget 20
--set engine=kinematic`` (same worlds), but each runs to its end, so that one violation does not
hide a later one, and ``human_clearance`` watches too, which campaigns leave out unless asked and
which does not count as failed here; ``--early-stop`` does all as a campaign does. CPU time is that
of this process, scene included, program compiled before.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.specs.library import default_specifications
from mrta_falsify.trial import Job, campaign_specifications, judge
from scenic_worlds.program import RejectedScene, compile_program
from scenic_worlds.shipped import scenario_names, scenario_path


@dataclass
class Tally:
    """What the trials of one program came to."""

    dimensions: int
    trials: int = 0
    rejected: int = 0
    failed: int = 0  #: by a specification that campaigns use by default
    by_spec: Counter[str] = field(default_factory=Counter)
    cpu_s: list[float] = field(default_factory=list)
    sim_s: list[float] = field(default_factory=list)
    robots: list[int] = field(default_factory=list)
    tasks: list[int] = field(default_factory=list)

    def row(self) -> dict[str, Any]:
        """The figures of a table's row."""
        return {
            "k": self.dimensions,
            "robots": statistics.median(self.robots),
            "tasks": statistics.median(self.tasks),
            "trials": self.trials,
            "rejected": self.rejected,
            "failed": self.failed,
            "by_spec": dict(sorted(self.by_spec.items())),
            "sim_s": round(statistics.median(self.sim_s)),
            "cpu_s": round(statistics.median(self.cpu_s), 2),
        }


def measured(name: str, numbers: range, seed: int, *, early_stop: bool, verbose: bool) -> Tally:
    """Trials ``numbers`` of a random campaign on a program."""
    program = compile_program(scenario_path(name))
    config = StackConfig(engine=Choice("kinematic"))
    specifications = campaign_specifications() if early_stop else default_specifications()
    tally = Tally(len(program.space))
    for number in numbers:
        began = time.process_time()
        try:
            found = program.realise(program.candidate(seed, number))
        except RejectedScene:
            tally.rejected += 1
            continue
        assert found.candidate.seed == candidate_seed(seed, number)
        world = found.world
        judged = judge(Job(world=world, config=config, specifications=specifications,
                           early_stop=early_stop, scene=found.scene))  # fmt: skip
        violated = [verdict for verdict in judged.verdicts if verdict.violated]
        tally.trials += 1
        tally.failed += any(verdict.spec in campaign_specifications() for verdict in violated)
        tally.by_spec.update(verdict.spec for verdict in violated)
        tally.cpu_s.append(time.process_time() - began)
        tally.sim_s.append(judged.outcome.sim_time)
        tally.robots.append(len(world.robots))
        tally.tasks.append(len(world.tasks))
        if verbose:
            said = ", ".join(f"{v.spec} {v.robustness:.2f} {'/'.join(v.who)}" for v in violated)
            margins = next(v for v in judged.verdicts if v.spec == "deadlines").evidence["margins"]
            print(
                f"  {number:3} {judged.outcome.ended:15} {judged.outcome.sim_time:6.1f} s, "
                f"CPU {tally.cpu_s[-1]:4.1f} s, {said or 'ok'}; margins "
                f"{sorted(round(value) for value in margins.values())}",
                flush=True,
            )
    return tally


def main() -> None:
    """Print one row per program."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("programs", nargs="*")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first trial")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--early-stop", action="store_true")
    parser.add_argument("--verbose", action="store_true", help="a line per trial")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = {}
    print(f"{'program':24} {'k':>4} {'robots':>6} {'tasks':>5} {'sim s':>6} {'CPU s':>6} failed")
    for name in arguments.programs or scenario_names():
        tally = measured(
            name,
            range(arguments.first, arguments.first + arguments.trials),
            arguments.seed,
            early_stop=arguments.early_stop,
            verbose=arguments.verbose,
        )
        row = rows[Path(name).stem] = tally.row()
        specs = ", ".join(f"{spec} {count}" for spec, count in row["by_spec"].items())
        print(
            f"{Path(name).stem:24} {row['k']:4} {row['robots']:6.0f} {row['tasks']:5.0f} "
            f"{row['sim_s']:6} {row['cpu_s']:6} {row['failed']} of {row['trials']}"
            f"{f' ({tally.rejected} rejected)' if tally.rejected else ''}: {specs or 'none'}",
            flush=True,
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
