"""The mutation benchmark; see README.md beside this file.

python -m benchmarks.mutation worlds DIR [--worlds 200]
python -m benchmarks.mutation draw DIR [--count 80] [--seed 0] [--reached]
python -m benchmarks.mutation take DIR FILE.json|FOLDER
python -m benchmarks.mutation killable DIR
python -m benchmarks.mutation search DIR [--samplers random auto] [--budget 60]
python -m benchmarks.mutation report DIR

Each goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from benchmarks.mutation.bench import Bench
from benchmarks.mutation.killing import Hunted, hunt
from benchmarks.mutation.mutants import Mutant, mutated_texts, read_mutants, write_mutants
from benchmarks.mutation.places import draw_mutants
from benchmarks.mutation.process import StackProcess
from benchmarks.mutation.report import report
from benchmarks.mutation.runs import Run, reasons
from benchmarks.mutation.searching import Plan, Searched, search
from benchmarks.mutation.sound import SoundRuns
from benchmarks.mutation.tasks import Tasks, Worker
from benchmarks.mutation.trees import digest_of, sound_tree
from benchmarks.mutation.worlds import (
    Case,
    corpus_cases,
    mutation_specifications,
    read_cases,
    uniform_cases,
    write_cases,
)
from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.core import codec
from mrta_falsify.core.errors import HarnessError, InputError

T = TypeVar("T")
R = TypeVar("R")
WORLDS, MUTANTS, SOUND = "worlds.json.gz", "mutants.json", "sound.jsonl"
KILLABLE, SEARCHED, REPORT = "killable.jsonl", "searched.jsonl", "report.md"
WORLD_SEED = 20261122  # of the uniform worlds; searches have other seeds


def main() -> int:
    """Run a command: 0, 2 for wrong input, 3 if the sound stack fails to run, 130 after Ctrl-C."""
    options = _options()
    does = {
        "worlds": worlds,
        "draw": draw,
        "take": take,
        "killable": killable,
        "search": searches,
        "report": tell,
    }
    try:
        options.directory.mkdir(parents=True, exist_ok=True)
        does[options.what](options)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except HarnessError as error:
        print(error, file=sys.stderr)
        return 3
    except KeyboardInterrupt:
        print("interrupted; the same command goes on", file=sys.stderr)
        return 130
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.mutation",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_subparsers(dest="what", required=True)
    parsers = {}
    for name in ("worlds", "draw", "take", "killable", "search", "report"):
        parsers[name] = what.add_parser(name)
        parsers[name].add_argument("directory", type=Path)
    for name in ("worlds", "killable", "search"):
        parsers[name].add_argument("--workers", type=int, default=2)
    parsers["worlds"].add_argument("--worlds", type=int, default=200, help="uniform ones")
    parsers["worlds"].add_argument("--no-corpus", action="store_true")
    parsers["draw"].add_argument("--count", type=int, default=80)
    parsers["draw"].add_argument("--seed", type=int, default=0)
    parsers["draw"].add_argument(
        "--reached", action="store_true", help="only lines that run in some world, or are compiled"
    )
    parsers["take"].add_argument("mutants", type=Path, help="JSON list, or a folder of patches")
    for name in ("killable", "search"):
        parsers[name].add_argument("--only", nargs="+", metavar="MUTANT")
    parsers["search"].add_argument("--samplers", nargs="+", default=["random", "auto"])
    parsers["search"].add_argument("--budget", type=int, default=60)
    parsers["search"].add_argument("--lanes", type=int, default=3, help="scenarios of a mutant")
    parsers["search"].add_argument("--seed", type=int, default=1)
    return parser.parse_args()


# --- worlds ----------------------------------------------------------------------------------


def worlds(options: argparse.Namespace) -> None:
    """Draw the worlds, and run the sound stack in each, line by line."""
    path = options.directory / WORLDS
    trees = options.directory / "trees"
    if not path.is_file():
        with StackProcess(trees, sound_tree(trees)) as process:
            cases = list(uniform_cases(process, options.worlds, WORLD_SEED))
        write_cases([*cases, *(() if options.no_corpus else corpus_cases())], path)
    bench = open_bench(options.directory)
    missing = [case for case in bench.cases if _has_no_lines(bench, case)]

    def work(case: Case, worker: Worker) -> Run:
        return bench.sound.run(worker.sound, case.world, case.stack, lines=True)

    def keep(case: Case, run: Run) -> str:
        return f"{case.name}: {', '.join(reasons(run)) or 'passes'} in {run.cpu_s:.1f} s of CPU"

    _run(Tasks(work, keep, "world"), missing, bench, options.workers)
    runs = [bench.sound.known(case.world, case.stack) for case in bench.cases]
    failed = sum(run is not None and bool(reasons(run)) for run in runs)
    print(f"{len(runs)} worlds; the sound stack fails in {failed}, which are not used")


def _has_no_lines(bench: Bench, case: Case) -> bool:
    known = bench.sound.known(case.world, case.stack)
    return known is None or not known.lines


# --- mutants ---------------------------------------------------------------------------------


def draw(options: argparse.Namespace) -> None:
    """Draw mutants at random."""
    tree = sound_tree(options.directory / "trees")
    bench = open_bench(options.directory) if options.reached else None
    mutants = draw_mutants(
        tree, count=options.count, seed=options.seed, may_change=_reached_lines(bench)
    )
    _keep_mutants(options.directory, mutants)


def _reached_lines(bench: Bench | None) -> dict[str, set[int]] | None:
    """Collect the lines that run in some world, by file; None: nothing is known of them."""
    if bench is None:
        return None
    found: dict[str, set[int]] = {}
    for case in bench.cases:
        run = bench.sound.known(case.world, case.stack)
        for path, lines in (run.lines if run else {}).items():
            found.setdefault(path, set()).update(lines)
    return found


def take(options: argparse.Namespace) -> None:
    """Take mutants that somebody else has made; those that do not fit are refused."""
    mutants = read_mutants(options.mutants)
    tree = sound_tree(options.directory / "trees")
    for mutant in mutants:
        mutated_texts(mutant, tree)
    _keep_mutants(options.directory, mutants)


def _keep_mutants(directory: Path, mutants: Sequence[Mutant]) -> None:
    path = directory / MUTANTS
    if path.is_file() and read_mutants(path) != tuple(mutants):
        raise InputError(f"{path}: holds other mutants; choose another directory")
    write_mutants(mutants, path)
    print(f"{len(mutants)} mutants in {path}")


# --- runs ------------------------------------------------------------------------------------


def killable(options: argparse.Namespace) -> None:
    """Find out which mutants can be killed at all."""
    bench = open_bench(options.directory)
    path = options.directory / KILLABLE
    known = _hunted(path)
    missing = [mutant for mutant in _mutants(options) if mutant.id not in known]

    def work(mutant: Mutant, worker: Worker) -> Hunted:
        return hunt(bench, mutant, worker.sound, worker.running)

    def keep(mutant: Mutant, row: Hunted) -> str:
        append_row(path, codec.encode(row))
        how = f" by {', '.join(row.why)} in {row.case} ({row.copies})" if row.why else ""
        took = f"{row.wall_s:.0f} s, CPU {row.cpu_s:.0f} s and {row.compile_s:.0f} s compiling"
        return f"{mutant.id}: {row.status}{how}, {row.runs} runs, {took}"

    _run(Tasks(work, keep, "mutant"), missing, bench, options.workers)
    tell(options)


def searches(options: argparse.Namespace) -> None:
    """Search for each killable mutant with each sampler."""
    bench = open_bench(options.directory)
    path = options.directory / SEARCHED
    hunted = _hunted(options.directory / KILLABLE)
    done = {(row.mutant, row.sampler) for row in _searched(path)}
    plans = [
        (mutant, Plan(sampler=name, budget=options.budget, lanes=options.lanes, seed=options.seed))
        for mutant in _mutants(options)
        for name in options.samplers
        if (mutant.id, name) not in done
    ]
    missing = [
        (mutant, plan)
        for mutant, plan in plans
        if mutant.id in hunted and hunted[mutant.id].status == "killable"
    ]

    def work(task: tuple[Mutant, Plan], worker: Worker) -> Searched:
        return search(bench, *task, worker.sound, worker.running)

    def keep(task: tuple[Mutant, Plan], row: Searched) -> str:
        append_row(path, codec.encode(row))
        found = f"killed at {row.found_at}" if row.found_at else f"alive after {row.trials}"
        named = f", {row.named or 'no layer'} named, {row.layer or 'several'} right"
        took = f"{row.wall_s:.0f} s, CPU {row.cpu_s:.0f} s and {row.compile_s:.0f} s compiling"
        return f"{row.mutant} {row.sampler}: {found}{named if row.found_at else ''}, {took}"

    _run(Tasks(work, keep, "search"), missing, bench, options.workers)
    tell(options)


def tell(options: argparse.Namespace) -> None:
    """Write the report."""
    hunted = _hunted(options.directory / KILLABLE)
    mutants = read_mutants(options.directory / MUTANTS)
    text = report(mutants, hunted, tuple(_searched(options.directory / SEARCHED)))
    (options.directory / REPORT).write_text(text, encoding="utf-8")
    print(text)


def open_bench(directory: Path) -> Bench:
    """Open the benchmark of a directory.

    Raises:
        InputError: it has no worlds yet.
    """
    path = directory / WORLDS
    if not path.is_file():
        raise InputError(f"{path}: there are no worlds yet; run the command worlds first")
    code = digest_of(sound_tree(directory / "trees"))
    sound = SoundRuns(directory / SOUND, mutation_specifications(), code)
    return Bench(directory=directory, cases=read_cases(path), sound=sound)


def _mutants(options: argparse.Namespace) -> tuple[Mutant, ...]:
    path = options.directory / MUTANTS
    if not path.is_file():
        raise InputError(f"{path}: there are no mutants yet; run the command draw or take first")
    mutants = read_mutants(path)
    unknown = set(options.only or ()) - {mutant.id for mutant in mutants}
    if unknown:
        raise InputError(f"{path}: has no mutant {', '.join(sorted(unknown))}")
    return tuple(m for m in mutants if not options.only or m.id in options.only)


def _hunted(path: Path) -> dict[str, Hunted]:
    rows = (codec.decode(Hunted, row, where=str(path)) for row in read_rows(path))
    return {row.mutant: row for row in rows}


def _searched(path: Path) -> Iterator[Searched]:
    for row in read_rows(path):
        yield codec.decode(Searched, row, where=str(path))


def _run(tasks: Tasks[T, R], missing: Sequence[T], bench: Bench, workers: int) -> None:
    made = [Worker(bench.sound_process()) for _ in range(min(workers, max(1, len(missing))))]
    try:
        tasks.run(missing, made)
    finally:
        for worker in made:
            worker.sound.close()


if __name__ == "__main__":
    sys.exit(main())
