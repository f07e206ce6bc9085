"""Is a run the same through the door: in process, in Python, in C++, copied by fork and by replay?

    python -m benchmarks.door.same_run FILE --worlds 50 --seconds 30 --oracle 1

Each world is run on both engines, and judged as a campaign judges it. The shipped stack runs in
this process and through the socket; its copies are made by fork and by replay in turn. A stack of
one lane runs in Python and in C++, copied both ways, in worlds with and without deadlocks. Cases
of the oracle's benchmark run in process and copied by replay. All of a row must agree in trace
digest and verdicts, members and times included.

Rows are kept in FILE, one line of JSON each; a second call goes on.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.oracle.worlds import case_named, cases
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.trial import campaign_specifications
from scenic_worlds.program import compile_program
from simulator_interface.simulate import simulate
from tests.external.lane_worlds import built, lane_config, lane_world
from tests.external.test_copies import outside
from tests.recorded.record import ENGINES, SCENARIOS, stored_cases, stored_world

#: programs whose draws fill the list of worlds up
DRAWN = ("narrow_pair", "closing_doors", "single_file", "radio_gaps_tight", "three_walkers")
FIRST_DRAW = 10  # number of the candidate; the recorded worlds have the first
WAYS = ("fork", "replay")
#: of a lane: offset of the start [m], whether somebody comes the other way, robots behind
LANES = ((0.0, True, 0), (0.3, True, 1), (0.7, True, 2), (0.1, False, 0), (0.5, True, 1))
LABELS = ("one lane", "shipped stack", "oracle's benchmark")
LANE, ORACLE = "lane ", "oracle "  # what names of rows begin with
FIRST_CASE = 20000  # seed of the oracle's cases


class Row(NamedTuple):
    """What is run, and what each way of running it gave."""

    name: str
    engine: str
    runs: dict[str, list]  #: by way: digest, and verdicts as they are stored


Runs = dict[str, Callable[[], list]]


def judged(world: World, config: StackConfig, names: tuple[str, ...] = ()) -> list:
    """Run a world until a deadlock is claimed, or to the end.

    Args:
        names: of specifications; empty: those of a campaign.
    """
    names = names or campaign_specifications()
    judges = build_specifications(names)
    deadlock = judges[names.index("no_deadlock")]

    def stop(frame: Frame) -> str:
        return "decided" if deadlock.verdict().violated else ""

    outcome = simulate(world, config, specifications=judges, stop=stop)
    return [outcome.trace.digest, codec.encode(outcome.verdicts)]


def shipped(worlds: int, seconds: float, folder: Path) -> Iterator[tuple[str, str, Runs]]:
    """List the runs of the shipped stack."""
    for number, (name, world, config) in enumerate(_cases(worlds)):
        short = dataclasses.replace(world, horizon=min(world.horizon, seconds))
        for engine in ENGINES:
            chosen = dataclasses.replace(config, engine=Choice(engine))
            way = WAYS[number % len(WAYS)]
            through = outside(short, chosen, folder, way)
            yield f"{number} {name}", engine, {
                "in process": partial(judged, short, chosen),
                f"Python, {way}": partial(judged, short, through),
            }  # fmt: skip


def _cases(count: int) -> Iterator[tuple[str, World, StackConfig]]:
    stored = stored_cases()[:count]
    for row in stored:
        yield row["name"], stored_world(row["name"]), codec.decode(StackConfig, row["stack"])
    programs = {}
    for number in range(count - len(stored)):
        name = DRAWN[number % len(DRAWN)]
        if name not in programs:
            programs[name] = compile_program(SCENARIOS / f"{name}.scenic")
        candidate = programs[name].candidate(0, FIRST_DRAW + number)
        yield name, programs[name].realise(candidate).world, StackConfig()


def lanes(folder: Path) -> Iterator[tuple[str, str, Runs]]:
    """List the runs of the stack of one lane."""
    program = built(folder)
    stacks = {"Python": None, **({"C++": program} if program else {})}
    for offset, head_on, followers in LANES:
        world = lane_world(offset, head_on=head_on, followers=followers)
        for engine in ENGINES:
            name = f"{LANE}{offset:g} {'head-on' if head_on else 'one way'} {followers}"
            yield name, engine, {
                f"{language}, {way}": partial(judged, world, lane_config(stack, way, engine))
                for language, stack in stacks.items()
                for way in WAYS
            }  # fmt: skip


def oracle_cases(rounds: int, folder: Path) -> Iterator[tuple[str, str, Runs]]:
    """List the cases of the oracle's benchmark with the shipped stack."""
    for name in cases(rounds, first=FIRST_CASE):
        case = case_named(name)
        if case.config.stack is not None:
            continue  # it has no layers that could run behind the door
        through = outside(case.world, case.config, folder, "replay")
        yield f"{ORACLE}{name}", case.config.engine.name, {
            "in process": partial(judged, case.world, case.config, ("no_deadlock",)),
            "Python, replay": partial(judged, case.world, through, ("no_deadlock",)),
        }  # fmt: skip


def run_all(file: Path, worlds: int, seconds: float, rounds: int) -> list[Row]:
    """Run what is not in ``file`` yet."""
    lines = file.read_text().splitlines() if file.exists() else ()
    rows = [Row(*json.loads(line)) for line in lines]
    known, began, fresh = {(row.name, row.engine) for row in rows}, time.monotonic(), 0
    total = len(ENGINES) * (worlds + len(LANES)) + len([*cases(rounds)])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources = shipped(worlds, seconds, folder), lanes(folder), oracle_cases(rounds, folder)
        for source in sources:
            for case, engine, runs in source:
                if (case, engine) in known:
                    continue
                row = Row(case, engine, {way: run() for way, run in runs.items()})
                rows.append(row)
                with file.open("a") as journal:
                    journal.write(json.dumps(row) + "\n")
                fresh += 1
                left = (time.monotonic() - began) / fresh * (total - len(rows))
                print(f"{len(rows)} of {total}, {left:.0f} s left", file=sys.stderr, flush=True)
    return rows


def is_same(row: Row) -> bool:
    """Whether all runs of a row agree, but for how a copy has been asked again."""
    first, *others = [[digest, [*map(_plain, verdicts)]] for digest, verdicts in row.runs.values()]
    return all(other == first for other in others)


def _plain(verdict: dict[str, Any]) -> dict[str, Any]:
    """Keep of `repeatable` whether it fails: a copy by replay tells every tick again, even of a
    run that ends before the first fork."""
    if verdict["spec"] != "repeatable":
        return verdict
    return {key: verdict[key] for key in ("spec", "violated", "who")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--worlds", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=30.0, help="longest run [s]")
    parser.add_argument("--oracle", type=int, default=0, help="rounds of the oracle's benchmark")
    arguments = parser.parse_args()
    rows = run_all(arguments.file, arguments.worlds, arguments.seconds, arguments.oracle)
    print("| | Engine | Runs | Same | Deadlocks |\n|---|---|---|---|---|")
    for label in LABELS:
        for engine in ENGINES:
            some = [row for row in rows if row.engine == engine and _label(row) == label]
            if not some:
                continue
            runs = sum(len(row.runs) for row in some)
            same = sum(map(is_same, some))
            found = sum(_has_deadlock(row) for row in some)
            print(f"| {label} | {engine} | {runs} | {same} of {len(some)} worlds | {found} |")
    others = [f"{row.name} ({row.engine})" for row in rows if not is_same(row)]
    print(*(f"differs: {name}" for name in others), sep="\n")
    sys.exit(bool(others))


def _label(row: Row) -> str:
    return LABELS[0 if row.name.startswith(LANE) else 1 + row.name.startswith(ORACLE)]


def _has_deadlock(row: Row) -> bool:
    verdicts = next(iter(row.runs.values()))[1]
    return any(v["spec"] == "no_deadlock" and v["violated"] for v in verdicts)


if __name__ == "__main__":
    main()
