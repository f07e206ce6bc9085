"""Record what the toolkit does today, and compare a later version with it.

    python -m tests.recorded.record runs       # rewrites runs.json and worlds/
    python -m tests.recorded.record campaigns  # rewrites campaigns/ (only ever in one version)
    python -m tests.recorded.record compare [--engines kinematic] [--only NAME ...]

``compare`` ends with exit code 1 if something differs.

A case is one world under one stack. It is judged on both engines as a campaign judges it. What is
kept of a run is its trace digest, how it ended, its signature and suspected layer, and of each
verdict the robustness, the time and the robots.
"""

from __future__ import annotations

import argparse
import dataclasses
import gzip
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.signature import signature_before
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.world import World
from mrta_falsify.specs.attribution import guess
from mrta_falsify.trial import Job, campaign_specifications, judge

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
RUNS = HERE / "runs.json"
WORLDS = HERE / "worlds"
CAMPAIGNS = HERE / "campaigns"
ENGINES = ("kinematic", "bullet")
SCENARIOS = HERE / "scenarios"

#: name, scenario, number of the candidate, changes of the stack
SAMPLED = (
    ("single_file", "single_file", 0, {}),
    ("single_file_decentralised", "single_file", 1, {"controller": "decentralised_cbf"}),
    ("narrow_pair", "narrow_pair", 2, {}),
    ("narrow_pair_by_distance", "narrow_pair", 3, {"priority_rule": "distance_to_goal"}),
    ("three_walkers", "three_walkers", 1, {}),
    ("closing_doors", "closing_doors", 4, {}),
    ("cluttered_corridor", "cluttered_corridor", 0, {"planner": "ompl"}),
    ("late_batches", "late_batches", 0, {"allocator": "auction"}),
    ("radio_gaps_tight", "radio_gaps_tight", 5, {}),
    ("bed_in_the_doorway", "bed_in_the_doorway", 3, {"queue_policy": "deadline_first"}),
    ("warehouse_shift", "warehouse_shift", 0, {}),
    ("hospital_day", "hospital_day", 0, {}),
)
#: name, arguments of ``mrta-falsify campaign``
SEARCHES = {
    "beds": ("bed_in_the_doorway", "--budget", "8", "--sampler", "random"),
    "stalls": (
        str((SCENARIOS / "same_room.scenic").relative_to(ROOT)),
        *("--budget", "6", "--perturbed", "2"),
        *("--set", "defects=[same_room_twice_stalls]"),
    ),
}


def new_cases() -> Iterator[tuple[str, World, StackConfig]]:
    """Twelve planted defects, and twelve worlds that campaigns sample."""
    from mrta_falsify.testing.planted import PLANTS
    from scenic_worlds.program import compile_program, scenario_path

    for defect, plant in PLANTS.items():
        yield defect, plant.world(1), StackConfig(defects=(defect,))
    for name, scenario, number, layers in SAMPLED:
        own = SCENARIOS / f"{scenario}.scenic"
        program = compile_program(own if own.is_file() else scenario_path(scenario))
        config = StackConfig(**{layer: Choice(choice) for layer, choice in layers.items()})
        realised = program.realise(program.candidate(0, number))
        yield name, realised.world, config


def stored_cases() -> list[dict[str, Any]]:
    """The rows of ``runs.json``."""
    rows: list[dict[str, Any]] = json.loads(RUNS.read_text())["cases"]
    return rows


def stored_world(name: str) -> World:
    """World of a case."""
    data = json.loads(gzip.decompress((WORLDS / f"{name}.json.gz").read_bytes()))
    return codec.decode(World, data, where=name)


def outcome_of(name: str, stack: dict[str, Any], engine: str) -> dict[str, Any]:
    """What a case does on one engine now."""
    config = codec.decode(StackConfig, stack, where=name)
    config = dataclasses.replace(config, engine=Choice(engine))
    world = stored_world(name)
    job = Job(
        world=world, config=config, specifications=campaign_specifications(config), early_stop=True
    )
    judged = judge(job)
    return {
        "world_digest": world.digest(),
        "trace_digest": judged.outcome.trace.digest,
        "ended": judged.outcome.ended,
        "signature": signature_before(judged.verdicts),  # the form that the rows were stored in
        "layer": guess(judged.verdicts, judged.outcome.trace).layer if judged.failed else "",
        "verdicts": [
            [v.spec, repr(v.robustness), v.violated_at, list(v.who)] for v in judged.verdicts
        ],
    }


def record_runs() -> None:
    """Write ``runs.json`` and the worlds."""
    cases = []
    WORLDS.mkdir(exist_ok=True)
    for name, world, config in new_cases():
        text = json.dumps(codec.encode(world), separators=(",", ":")).encode()
        (WORLDS / f"{name}.json.gz").write_bytes(gzip.compress(text, mtime=0))
        cases.append({"name": name, "stack": codec.encode(config)})
    rows = [
        {**case, "engines": dict(zip(ENGINES, done, strict=True))}
        for case, done in zip(cases, _on_engines(cases, ENGINES), strict=True)
    ]
    RUNS.write_text(json.dumps({"cases": rows}, indent=1) + "\n")


def _on_engines(
    cases: list[dict[str, Any]], engines: Sequence[str]
) -> Iterator[list[dict[str, Any]]]:
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        jobs = [
            [pool.submit(outcome_of, case["name"], case["stack"], engine) for engine in engines]
            for case in cases
        ]
        for runs in jobs:
            yield [run.result() for run in runs]


def compare_runs(cases: list[dict[str, Any]], engines: Sequence[str] = ENGINES) -> list[str]:
    """What differs from ``runs.json`` now, a line each."""
    found = []
    for case, runs in zip(cases, _on_engines(cases, engines), strict=True):
        for engine, run in zip(engines, runs, strict=True):
            found += differences(case, engine, run)
    return found


def differences(case: dict[str, Any], engine: str, run: dict[str, Any]) -> list[str]:
    """What differs between a recorded run and the same run now."""
    then, now = case["engines"][engine], json.loads(json.dumps(run))
    return [
        f"{case['name']}, {engine}: {key} was {then[key]}, is {now[key]}"
        for key in then
        if then[key] != now[key]
    ]


def record_campaigns() -> None:
    """Write two small campaigns with all that the commands keep beside their failures."""
    if CAMPAIGNS.exists():
        shutil.rmtree(CAMPAIGNS)
    for name, arguments in SEARCHES.items():
        place = CAMPAIGNS / name
        _mrta("campaign", *arguments, "-o", str(place), "--set", "engine=kinematic")
        listed = json.loads(_mrta("list", str(place), "--failed", "--format", "json"))
        first = listed[0]["id"]
        _mrta("replay", str(place), first, "--verify", "2")
        _mrta("explain", str(place), first, "--max-runs", "14")
        _mrta("minimize", str(place), first)
        for command in ("list", "corpus"):
            text = _mrta(command, str(place), "--format", "json")
            (CAMPAIGNS / f"{name}.{command}.json").write_text(text)


def _mrta(*arguments: str) -> str:
    command = [sys.executable, "-m", "mrta_falsify.cli", *arguments]
    print(" ".join(arguments), file=sys.stderr, flush=True)
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode not in (0, 1):
        raise SystemExit(done.stderr)
    return done.stdout


def main() -> None:
    """Run the part that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("runs", "campaigns", "compare"))
    parser.add_argument("--engines", nargs="*", default=ENGINES, choices=ENGINES)
    parser.add_argument("--only", nargs="*", metavar="NAME")
    options = parser.parse_args()
    if options.part == "runs":
        record_runs()
    elif options.part == "campaigns":
        record_campaigns()
    else:
        cases = [
            case for case in stored_cases() if not options.only or case["name"] in options.only
        ]
        found = compare_runs(cases, options.engines)
        print(
            "\n".join(found) or f"{len(cases)} cases on {' and '.join(options.engines)}: all equal"
        )
        sys.exit(bool(found))


if __name__ == "__main__":
    main()
