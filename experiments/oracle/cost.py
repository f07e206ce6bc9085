"""What the deadlock oracle costs: CPU time of six recorded worlds with `no_deadlock` and without.

    python -m experiments.oracle.cost [--repeats 2] [--engines kinematic bullet] [-o cost.json]

Each trial is a process of its own and they take turns: with, without. A trial with the oracle ends
at its first claim, as in a campaign; the one without it ends at the same simulated time. Forked
copies count. Compiling and imports do not: each process runs one second first.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from experiments.oracle.rows import cpu_seconds
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.specs.library import build_specifications, default_specifications
from simulator_interface.simulate import simulate
from tests.recorded.record import stored_cases, stored_world

WORLDS = (
    "single_file_decentralised",
    "narrow_pair",
    "bed_in_the_doorway",
    "cluttered_corridor",
    "warehouse_shift",
    "hospital_day",
)
ORACLE = "no_deadlock"
WARM_UP = 1.0  # s of simulation before the clock starts
FOREVER = 1e9  # s


def trial(name: str, engine: str, *, oracle: bool, until: float) -> dict[str, Any]:
    """Run a recorded world in this process.

    Args:
        name: of the world.
        engine: by name.
        oracle: whether `no_deadlock` judges it beside the other default specifications.
        until: simulated time [s] at which it ends at the latest.
    """
    stack = next(row["stack"] for row in stored_cases() if row["name"] == name)
    config = codec.decode(StackConfig, stack, where=name)
    config = dataclasses.replace(config, engine=Choice(engine))
    _run(name, config, oracle=oracle, until=WARM_UP)
    began = cpu_seconds()
    found = _run(name, config, oracle=oracle, until=until)
    return {"world": name, "engine": engine, **found, "cpu_s": round(cpu_seconds() - began, 2)}


def _run(name: str, config: StackConfig, *, oracle: bool, until: float) -> dict[str, Any]:
    names = [spec for spec in default_specifications() if spec != ORACLE or oracle]
    specifications = build_specifications(names)
    judges = [spec for spec, own in zip(specifications, names, strict=True) if own == ORACLE]

    def stop(frame: Frame) -> str:
        if frame.sensed.time >= until:
            return "time is up"
        return "claimed" if any(judge.verdict().violated for judge in judges) else ""

    outcome = simulate(
        stored_world(name), config, specifications=specifications, keep_trace=False, stop=stop
    )
    return {"sim_s": round(outcome.sim_time, 2), "ended": outcome.ended}


def _trial_apart(name: str, engine: str, until: float | None) -> dict[str, Any]:
    """Run a trial in a process of its own; ``until`` None: with the oracle."""
    command = [sys.executable, "-m", "experiments.oracle.cost", "--trial", name, engine]
    command += [] if until is None else ["--until", str(until)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def measure(engine: str, repeats: int) -> list[dict[str, Any]]:
    """Measure all worlds on an engine, with and without the oracle in turn."""
    rows = []
    for name in WORLDS:
        pairs = []
        for _ in range(repeats):
            judged = _trial_apart(name, engine, None)
            plain = _trial_apart(name, engine, judged["sim_s"])
            pairs.append((judged["cpu_s"], plain["cpu_s"]))
        row = {"world": name, "engine": engine, "sim_s": judged["sim_s"], "ended": judged["ended"]}
        row |= {"with_s": min(with_s for with_s, _ in pairs)}
        row |= {"without_s": min(without_s for _, without_s in pairs)}
        rows.append(row)
        print(f"{engine} {name}: {row['with_s']} s, without {row['without_s']} s", file=sys.stderr)
    return rows


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=2, help="least of so many counts")
    parser.add_argument("--engines", nargs="+", default=["kinematic", "bullet"])
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--trial", nargs=2, metavar=("WORLD", "ENGINE"), help=argparse.SUPPRESS)
    parser.add_argument("--until", type=float, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.trial:
        until = FOREVER if arguments.until is None else arguments.until
        print(json.dumps(trial(*arguments.trial, oracle=arguments.until is None, until=until)))
        return 0
    try:
        rows = [row for engine in arguments.engines for row in measure(engine, arguments.repeats)]
    except KeyboardInterrupt:
        return 130
    text = json.dumps({"trials": rows}, indent=1)
    print(text)
    if arguments.output:
        arguments.output.write_text(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
