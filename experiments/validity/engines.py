"""Do three engines agree on which worlds fail?

    python -m experiments.validity.engines draw WORLDS.json [--of 30]
    python -m experiments.validity.engines judge WORLDS.json -o ROWS.json [--copies 4]
    python -m experiments.validity.engines table ROWS.json

`draw` samples shipped programs on the kinematic engine, one after the other, until it has 30 worlds
that fail and 30 that pass, and lists them. No other engine has run by then. `judge` runs each
listed world on all engines. Where they disagree, on failing or on its kind, it runs small
variations of the world on each; it goes on where it was stopped. `table` prints what came out.
"""

from __future__ import annotations

import argparse
import collections
import functools
import itertools
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from experiments.copies import perturbed_worlds
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.probability import blaker_interval
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.core.world import World
from mrta_falsify.possibility import look_at
from mrta_falsify.trial import Job, campaign_specifications, judge
from scenic_worlds.program import Program, compile_program, scenario_path

ENGINES = ("kinematic", "bullet", "mujoco")
FIRST = "kinematic"
PASSES = "passes"
SCENARIOS = (
    "bed_in_the_doorway",
    "narrow_doors",
    "hot_room",
    "single_file_corridor",
    "opposing_flows",
    "crowded_refuges",
    "slow_doors",
    "lifts_and_chargers",
    "parked_robots",
    "communication_outage",
)
SHARE = 5  # worlds of a scenario that fail, and that pass
DRAWS = 40  # worlds of a scenario at most

Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = parser.add_subparsers(dest="part", required=True)
    drawing = parts.add_parser("draw")
    drawing.add_argument("worlds", type=Path)
    drawing.add_argument("--of", type=int, default=30, help="worlds that fail, and that pass")
    drawing.add_argument("--seed", type=int, default=20)
    judging = parts.add_parser("judge")
    judging.add_argument("worlds", type=Path)
    judging.add_argument("-o", "--output", type=Path, required=True)
    judging.add_argument("--copies", type=int, default=4)
    showing = parts.add_parser("table")
    showing.add_argument("rows", type=Path)
    args = parser.parse_args()
    if args.part == "draw":
        drawn = draw(args.of, args.seed)
        args.worlds.write_text(json.dumps(drawn, indent=1) + "\n", encoding="utf-8")
    elif args.part == "judge":
        judge_all(json.loads(args.worlds.read_text(encoding="utf-8")), args.output, args.copies)
    else:
        print("\n".join(table(json.loads(args.rows.read_text(encoding="utf-8")))))


# --- worlds -----------------------------------------------------------------------------------


def draw(of: int, seed: int) -> list[Row]:
    """Sample programs in turn until there are ``of`` worlds that fail and ``of`` that pass."""
    drawn: list[Row] = []
    left = collections.Counter({True: of, False: of})
    streams = [_sampled(name, seed) for name in SCENARIOS]
    for row in itertools.chain.from_iterable(itertools.zip_longest(*streams)):
        if row is None or not left[row["fails"]]:
            continue
        left[row["fails"]] -= 1
        drawn.append(row)
        if not left.total():
            break
    return sorted(drawn, key=lambda row: (row["scenario"], row["seed"]))


def _sampled(scenario: str, seed: int) -> Iterator[Row]:
    """Sample one program: at most so many worlds that fail, and as many that pass."""
    left = collections.Counter({True: SHARE, False: SHARE})
    program = program_named(scenario)
    for number in range(DRAWS):
        if not left.total():
            return
        own = candidate_seed(seed, number)
        world = program.sample(own)
        if look_at(world, campaign_specifications(StackConfig())).reason:
            continue
        kind = run(world, FIRST)
        fails = kind != PASSES
        if not left[fails]:
            continue
        left[fails] -= 1
        print(f"{scenario:24} {number:3} {kind}", flush=True)
        yield {
            "scenario": scenario,
            "seed": own,
            "world": world.digest(),
            "fails": fails,
            "kind": kind,
        }


@functools.cache
def program_named(scenario: str) -> Program:
    """Compile a shipped program, once."""
    return compile_program(scenario_path(scenario))


# --- runs -------------------------------------------------------------------------------------


def run(world: World, engine: str) -> str:
    """Run a world under the default stack; its signature if it fails."""
    config = StackConfig(engine=Choice(engine))
    judged = judge(
        Job(
            world=world,
            config=config,
            specifications=campaign_specifications(config),
            early_stop=True,
        ),
        keep_trace=False,
    )
    return signature(judged.verdicts) if judged.failed else PASSES


def judge_all(worlds: Sequence[Row], output: Path, copies: int) -> None:
    """Run listed worlds on every engine; rows that are there are kept."""
    rows: list[Row] = json.loads(output.read_text(encoding="utf-8")) if output.exists() else []
    known = {(row["scenario"], row["seed"]) for row in rows}
    for of in worlds:
        if (of["scenario"], of["seed"]) in known:
            continue
        began = time.process_time()
        world = program_named(of["scenario"]).sample(of["seed"])
        if world.digest() != of["world"]:
            print(f"{of['scenario']} {of['seed']} is another world by now", file=sys.stderr)
            continue
        row = judged_on_all(of, world, copies)
        rows.append(row)
        output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        spent = time.process_time() - began
        print(
            f"{of['scenario']:24} {row['kinds']} {row.get('copies', '')} {spent:.0f} s", flush=True
        )


def judged_on_all(of: Row, world: World, copies: int) -> Row:
    """Run a world on every engine, and variations of it where engines disagree."""
    kinds = {engine: run(world, engine) for engine in ENGINES}
    row = {"scenario": of["scenario"], "seed": of["seed"], "world": of["world"], "kinds": kinds}
    if len(set(kinds.values())) > 1:
        varied = perturbed_worlds(world, copies)
        row["copies"] = {engine: [run(copy, engine) for copy in varied] for engine in ENGINES}
    return row


# --- what came out -----------------------------------------------------------------------------


def fails_mostly(row: Row, engine: str) -> bool:
    """Whether a world fails on an engine, with its variations where they were run."""
    kinds = [row["kinds"][engine], *row.get("copies", {}).get(engine, ())]
    return 2 * sum(kind != PASSES for kind in kinds) > len(kinds)


def fails_alone(row: Row, engine: str) -> bool:
    """Whether a world fails on an engine, in its one run."""
    return bool(row["kinds"][engine] != PASSES)


def table(rows: Sequence[Row]) -> list[str]:
    """Write agreement of pairs of engines, and each world on which two disagree."""
    lines = [f"{len(rows)} worlds", "", "| Engines | One run | With variations |", "|---|---|---|"]
    ways: tuple[Callable[[Row, str], bool], ...] = (fails_alone, fails_mostly)
    for pair in itertools.combinations(ENGINES, 2):
        agreed = [sum(way(row, pair[0]) == way(row, pair[1]) for row in rows) for way in ways]
        lines.append(
            f"| {', '.join(pair)} | " + " | ".join(_share(k, len(rows)) for k in agreed) + " |"
        )
    lines += ["", "| World | " + " | ".join(ENGINES) + " |", "|---|---|---|---|"]
    for row in rows:
        if "copies" in row:
            told = " | ".join(_told(row, engine) for engine in ENGINES)
            lines.append(f"| {row['scenario']} {row['world'][:8]} | {told} |")
    return lines


def _share(agreed: int, of: int) -> str:
    low, high = blaker_interval(agreed, of)
    return f"{agreed} of {of} ({100 * low:.0f} to {100 * high:.0f} %)"


def _told(row: Row, engine: str) -> str:
    copies = row["copies"][engine]
    return f"{row['kinds'][engine]}; {sum(kind != PASSES for kind in copies)} of {len(copies)} fail"


if __name__ == "__main__":
    main()
