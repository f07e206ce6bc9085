"""How small do minimised failures get, and is every one of them minimal, verified and kept?

    python -m experiments.reports.minimising DIR [DIR ...] -o OUT [--max-cases N] [--max-runs 60]
                                            [--per-signature 3] [--part 1/2]
    python -m experiments.reports.minimising -o OUT --table

The failed trials of any number of campaigns (DIR, or anywhere below it) are minimised as by
``mrta-falsify minimize``, into OUT; the campaigns themselves are not touched. Each result is
then checked by code of its own: the written world is read back and run on the written stack, every
single robot, task, person, piece of furniture and event is taken away once, and every pair of them
where there are at most 12, and the written Scenic program is compiled and run. What fails without a
pair counts if most of ten perturbed runs do, which is when the minimiser takes a pair away. A row
per case is kept in OUT/minimising.jsonl; a second call goes on. ``--table`` sums up.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiments.copies import perturbed_worlds
from experiments.reports.stored_failures import (
    StoredFailure,
    cpu_seconds,
    run_study,
    study_options,
)
from mrta_falsify.campaigns.signature import mechanism, signature
from mrta_falsify.core.config import read_config
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Minimisation
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.core.world import CommsOutage, Event, World, read_world
from mrta_falsify.specs.causes import leading
from mrta_falsify.testing.planted import PLANTS
from mrta_falsify.trial import Job, judge
from mrta_falsify.analysis.minimize import minimize
from mrta_falsify.analysis.minimize.edits import things_of
from mrta_falsify.analysis.minimize.reruns import PERTURBED
from mrta_falsify.analysis.minimize.sentences import minimal_text
from mrta_falsify.lab.stored import job_of
from scenic_worlds.program import compile_program
from simulator_interface.starts import check_starts

STUDY = "minimising"
MAX_THINGS = 12  # of a world whose pairs are all tried
THINGS = ("robots", "tasks", "humans", "furniture", "events")


def study(case: StoredFailure, folder: Path, max_runs: int) -> dict[str, Any]:
    """Minimise and check a failure; return its row, or why it was not minimised.

    Args:
        case: the failure.
        folder: for the files.
        max_runs: of the minimiser.
    """
    began = cpu_seconds()
    try:
        apart = case.kept_apart(folder)
        found = minimize(apart, case.record, max_runs=max_runs)
    except InputError as error:
        return {**case.facts(), "error": str(error)}
    spent = cpu_seconds() - began
    files = apart.folder(case.record)
    world = read_world(files / "world.min.json")
    stack = read_config(files / "stack.yaml")
    job = dataclasses.replace(job_of(apart, case.record), world=world, config=stack)
    again = judge(job)
    verdict = leading(again.verdicts)
    account = wait_account(verdict, again.outcome.trace) if verdict is not None else None
    wanted = mechanism(again.verdicts)
    spare = list(things_that_can_go(job, wanted))
    pairs = list(pairs_that_can_go(job, wanted))
    return {
        **case.facts(),
        "before": {name: found.counts[name][0] for name in THINGS},
        "after": {name: len(getattr(world, name)) for name in THINGS},
        "horizon_s": round(world.horizon, 1),
        "cycle": len(account.members) if account else 0,
        "waited_for": len(account.holding) if account else 0,
        "share_removed": round(found.share_removed, 4),
        "runs": found.runs,
        "finished": found.one_minimal,
        "said": minimal_text(found),
        "pairs": math.comb(len(things_of(world)), 2),
        "spare_pairs": pairs,
        "verified": again.outcome.trace.digest == found.trace_digest,
        "kept": bool(wanted) and wanted.split("/")[0] == found.signature.split("/")[0],
        "spare": spare,
        "program": program_fails(files / "world.min.scenic", job, found),
        "cpu_s": round(spent, 1),
        "check_cpu_s": round(cpu_seconds() - began - spent, 1),
    }


def things_that_can_go(job: Job, wanted: str) -> Iterator[str]:
    """Name the single things without which the same failure is still there.

    Args:
        job: the minimised world on its stack.
        wanted: signature of the failure.
    """
    for group in THINGS:
        for number, thing in enumerate(getattr(job.world, group)):
            try:
                smaller = taken_away(job.world, group, number)
                check_starts(smaller)
                if not (smaller.robots and smaller.tasks):
                    continue
                judged = judge(dataclasses.replace(job, world=smaller), keep_trace=False)
            except InputError:
                continue  # no valid world without it
            if mechanism(judged.verdicts) == wanted:
                yield getattr(thing, "name", f"task {number}")


def pairs_that_can_go(job: Job, wanted: str) -> Iterator[str]:
    """Name the pairs of things without which most perturbed runs still fail.

    Args:
        job: the minimised world on its stack.
        wanted: mechanism of the failure.
    """
    things = [(group, n) for group in THINGS for n in range(len(getattr(job.world, group)))]
    if len(things) > MAX_THINGS:
        return
    for one, other in itertools.combinations(things, 2):
        try:
            # the later one first, so that the number of the other one stays
            smaller = taken_away(taken_away(job.world, *other), *one)
            check_starts(smaller)
            if not (smaller.robots and smaller.tasks):
                continue
            judged = judge(dataclasses.replace(job, world=smaller), keep_trace=False)
        except InputError:
            continue
        if mechanism(judged.verdicts) == wanted and _most_fail(job, smaller, wanted):
            yield f"{one[0]} {one[1]} and {other[0]} {other[1]}"


def _most_fail(job: Job, world: World, wanted: str) -> bool:
    spec = wanted.split("/", maxsplit=1)[0]
    runs = [
        judge(dataclasses.replace(job, world=copy), keep_trace=False)
        for copy in perturbed_worlds(world, PERTURBED)
    ]
    failed = sum(any(v.violated and v.spec == spec for v in run.verdicts) for run in runs)
    return 2 * failed > len(runs)


def taken_away(world: World, group: str, number: int) -> World:
    """Leave one thing out of ``world``, and with a robot its outages.

    Raises:
        InputError: something else needs it.
    """
    kept = [thing for i, thing in enumerate(getattr(world, group)) if i != number]
    if group == "events":
        return dataclasses.replace(world, events=tuple(kept))
    if group != "robots":
        changes: dict[str, Any] = {group: tuple(kept)}
        return dataclasses.replace(world, **changes)
    gone = world.robots[number].name
    events: list[Event] = []
    for event in world.events:
        if isinstance(event, CommsOutage) and gone in event.robots:
            rest = tuple(name for name in event.robots if name != gone)
            if rest:
                events.append(dataclasses.replace(event, robots=rest))
        else:
            events.append(event)
    return dataclasses.replace(world, robots=tuple(kept), events=tuple(events))


def program_fails(path: Path, job: Job, found: Minimisation) -> str:
    """Say ``identical``, ``same failure``, ``other``, ``no program``, or why it does not run."""
    if not path.is_file():
        return "no program"
    try:
        judged = judge(dataclasses.replace(job, world=compile_program(path).sample(0)))
    except InputError as error:
        return f"does not run: {error}"
    if judged.outcome.trace.digest == found.trace_digest:
        return "identical"
    wanted = signature(found.verdicts)
    return "same failure" if signature(judged.verdicts) == wanted else "other"


# --- the table -----------------------------------------------------------------------------


def table(rows: list[dict[str, Any]]) -> str:
    """Write the rows of the study in words and Markdown tables."""
    done = [row for row in rows if "error" not in row]
    lines = [f"{len(rows)} failures of {len({r['signature'] for r in rows})} signatures"]
    lines += [f"not minimised: {row['case']}: {row['error']}" for row in rows if "error" in row]
    if not done:
        return "\n".join(lines)
    locked = [row for row in done if row["cycle"]]
    lean = [row for row in locked if row["after"]["robots"] <= row["cycle"]]
    chained = [row for row in locked if row["after"]["robots"] <= row["waited_for"]]
    single = [row for row in done if row["after"]["tasks"] <= row["after"]["robots"]]
    runs = [row["runs"] for row in done]
    shares = [row["share_removed"] for row in done]
    works = ("identical", "same failure")
    lines += [
        f"share removed: median {statistics.median(shares):.0%}, "
        f"from {min(shares):.0%} to {max(shares):.0%}",
        f"runs: median {statistics.median(runs):g}, most {max(runs)}; CPU time: median "
        f"{statistics.median(row['cpu_s'] for row in done):.0f} s",
        _share("1-minimal by the check", done, lambda row: not row["spare"]),
        _share("no pair can go by the check", done, lambda row: row.get("spare_pairs") == []),
        _share("said to be 1-minimal", done, lambda row: row["finished"]),
        _share("verified by replay of the written files", done, lambda row: row["verified"]),
        _share("signature kept", done, lambda row: row["kept"]),
        _share("Scenic program fails in the same way", done, lambda row: row["program"] in works),
        f"no more robots than the cycle: {len(lean)} of {len(locked)} deadlocks",
        f"no more robots than the cycle and whom it waits for: {len(chained)} of {len(locked)}",
        f"no more than one task for each robot: {len(single)} of {len(done)}",
        "",
        "| Case | Stack | Signature | robots | tasks | people | furniture | events | runs |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [_line(row) for row in done]
    lines += ["", *_exceptions(done, works), "", *against_known(done)]
    return "\n".join(lines)


def _share(what: str, rows: list[dict[str, Any]], holds: Any) -> str:
    return f"{what}: {sum(bool(holds(row)) for row in rows)} of {len(rows)}"


def _line(row: dict[str, Any]) -> str:
    counts = [f"{row['before'][name]} -> {row['after'][name]}" for name in THINGS]
    stack = ", ".join(row["defects"]) or "default"
    head = [f"{row['scenario']} {row['trial']}", stack, f"`{row['signature']}`"]
    return "| " + " | ".join([*head, *counts, str(row["runs"])]) + " |"


def _exceptions(rows: list[dict[str, Any]], works: tuple[str, ...]) -> Iterator[str]:
    """Yield what is not as it should be, case by case."""
    for row in rows:
        faults = []
        if row["spare"]:
            why = "" if row["finished"] else " (out of runs)"
            faults.append(f"could lose {', '.join(row['spare'])}{why}")
        if not row["verified"]:
            faults.append("its replay differs")
        if not row["kept"]:
            faults.append("its signature changed")
        if row["program"] not in works:
            faults.append(f"program: {row['program']}")
        if row["cycle"] and row["after"]["robots"] > row["waited_for"]:
            faults.append(
                f"{row['after']['robots']} robots, {row['cycle']} in the cycle, which waits for "
                f"{row['waited_for'] - row['cycle']} others"
            )
        if faults:
            yield f"- {row['case']}: {'; '.join(faults)}"


def against_known(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the smallest worlds of planted defects beside the known ones."""
    yield "| Defect | | robots | tasks | people | furniture | events |"
    yield "|---|---|---|---|---|---|---|"
    for row in rows:
        for defect in row["defects"]:
            if defect not in PLANTS:
                continue
            known = PLANTS[defect].world(0)
            sizes = [len(getattr(known, name)) for name in THINGS]
            found = [row["after"][name] for name in THINGS]
            yield f"| {defect} | known world | {' | '.join(map(str, sizes))} |"
            said = "no larger" if sum(found) <= sum(sizes) else "larger"
            case = f"{row['scenario']} {row['trial']} ({said})"
            yield f"| | {case} | {' | '.join(map(str, found))} |"


def main() -> None:
    """Run the command line."""
    parser = study_options(__doc__.splitlines()[0], max_runs=60, per_signature=3)
    options = parser.parse_args()
    run_study(STUDY, options, lambda case, folder: study(case, folder, options.max_runs), table)


if __name__ == "__main__":
    main()
