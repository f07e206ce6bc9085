"""The edge of feasibility: plans and proofs by `exact`, and what another solver says of them.

Deadlines of SMrTa's single files are scaled, replaced by one for all, and moved by bisection
to the last value that is possible and the first that is not. Every core is judged again by
:mod:`second_opinion`, its minimality by checked plans.
"""

from __future__ import annotations

import collections
import dataclasses
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.allocation.measuring import INSERTION, batch_problem, cpu, family
from mrta_falsify.core.allocation_problem import AllocationProblem
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.verification import verify
from simulator_interface.formats.smrta import SmrtaCase, read_case, read_travel_times
from tests.stack.second_opinion import can_be_covered

EXACT = Exact(ExactOptions(improvement_steps=0, fewest_lost=False))


@dataclass
class Probe:
    """One instance and what `exact` said."""

    name: str
    problem: AllocationProblem
    ms: float
    status: str
    core: tuple[int, ...]  #: empty without a proof
    fault: str  #: what the checker or insertion has against it


def probe(name: str, problem: AllocationProblem) -> Probe:
    ms, answer = cpu(lambda: EXACT.allocate(problem))
    faults = [str(fault) for fault in verify(answer, problem)]
    if INSERTION.allocate(problem).status == "plan" and answer.status != "plan":
        faults.append("insertion has a plan")
    core = answer.infeasible.core if answer.infeasible is not None else ()
    found = Probe(name, problem, ms, answer.status, core, "; ".join(faults))
    if ms > 1000.0:
        print(f"{name}: {ms / 1e3:.1f} s, {found.status}", file=sys.stderr, flush=True)
    return found


# --- instances ---------------------------------------------------------------------------------


def scaled(case: SmrtaCase, times, share: float) -> AllocationProblem:
    return batch_problem(case, times, deadline=lambda deadline: int(share * deadline))


def common(case: SmrtaCase, times, seconds: float) -> AllocationProblem:
    return batch_problem(case, times, deadline=lambda deadline: int(seconds))


def part_of(case: SmrtaCase, tasks: int, robots: int) -> SmrtaCase:
    """The first tasks and robots of a file with one batch."""
    return SmrtaCase(
        rooms=case.rooms[:robots], arrivals=case.arrivals, batches=(case.batches[0][:tasks],)
    )


def bisected(name: str, at: Callable[[float], AllocationProblem], low: float, high: float, least):
    """Probes at the value between ``low`` (impossible) and ``high`` where plans begin to exist."""
    while high - low > least:
        middle = (low + high) / 2.0
        found = probe(f"{name} {middle:.4g}", at(middle))
        yield found
        low, high = (low, middle) if found.status == "plan" else (middle, high)


def probes(root: Path) -> Iterator[Probe]:
    times = read_travel_times(root / "travel_time_65_rooms.json").times
    for path in sorted((root / "single").glob("*-0.json")):
        case = read_case(path, rooms=len(times))
        for share in (1.0, 0.8, 0.6, 0.5, 0.4):
            yield probe(f"{path.stem} x{share:g}", scaled(case, times, share))
        load = len(case.batches[0]) / len(case.rooms)
        for seconds in (110, 120, 130, 145, 160) if load <= 4 else ():
            horizon = int(seconds * (1 + max(0.0, load - 1.5) / 4))
            yield probe(f"{path.stem} h{horizon}", common(case, times, horizon))
    for path in sorted((root / "single").glob("*-1.json")):
        case = read_case(path, rooms=len(times))
        yield from bisected(f"{path.stem} x", lambda s, c=case: scaled(c, times, s), 0.1, 0.9, 0.01)
        if len(case.batches[0]) <= 20 and len(case.batches[0]) <= 3 * len(case.rooms):
            yield from bisected(
                f"{path.stem} h", lambda s, c=case: common(c, times, s), 60.0, 260.0, 2.0
            )
    for path in sorted((root / "single").glob("t_10_*-2.json")):
        case = read_case(path, rooms=len(times))
        for tasks, robots in ((4, 2), (5, 2), (5, 3)):
            small = part_of(case, tasks, robots)
            yield from bisected(
                f"{family(path)} first {tasks} on {robots} h",
                lambda s, c=small: common(c, times, s),
                60.0,
                260.0,
                4.0,
            )


# --- judgements --------------------------------------------------------------------------------


def summary(found: list[Probe]) -> dict:
    """Answers and times; cores judged again; agreement with the SMT allocator."""
    ms = np.array([one.ms for one in found])
    sizes = collections.Counter(len(one.core) for one in found if one.core)
    return {
        "instances": len(found),
        "answers": dict(collections.Counter(one.status for one in found)),
        "core_sizes": {str(k): sizes[k] for k in sorted(sizes)},
        "ms": {
            "median": round(float(np.median(ms)), 1),
            "p95": round(float(np.percentile(ms, 95)), 1),
            "max": round(float(ms.max()), 1),
        },
        "within_1_s": f"{100 * np.mean(ms <= 1000):.1f} %",
        "slower_than_1_s": [
            f"{one.name}: {one.ms / 1e3:.1f} s, {one.status}" for one in found if one.ms > 1000.0
        ],
        "faults": [f"{one.name}: {one.fault}" for one in found if one.fault],
        "cores": judge_cores([one for one in found if one.core]),
    }


def only(problem: AllocationProblem, numbers) -> AllocationProblem:
    tasks = tuple(task for task in problem.tasks if task.number in numbers)
    return dataclasses.replace(problem, tasks=tasks)


def judge_cores(found: list[Probe]) -> dict:
    """Cores by the second solver, and whether each is possible without any one of its tasks."""
    verdict: collections.Counter[str] = collections.Counter()
    minimal: collections.Counter[str] = collections.Counter()
    for one in found:
        said = can_be_covered(only(one.problem, one.core))
        verdict[{True: "CONTRADICTED", False: "confirmed", None: "not decided"}[said]] += 1
        if said is not False:
            print(f"{one.name}: core of {len(one.core)}: {said}", file=sys.stderr, flush=True)
        plans = [
            (rest, EXACT.allocate(rest))
            for k in one.core
            for rest in [only(one.problem, set(one.core) - {k})]
        ]
        shown = all(plan.status == "plan" and not verify(plan, rest) for rest, plan in plans)
        minimal["shown by checked plans" if shown else "NOT SHOWN"] += 1
    return {"judged": len(found), "infeasible": dict(verdict), "minimal": dict(minimal)}


def part_edge(root: Path) -> dict:
    return summary(list(probes(root)))
