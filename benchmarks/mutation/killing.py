"""Can a mutant be killed at all: does it fail by the copies' rule in any world of the benchmark?"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from benchmarks.mutation.bench import Bench, Trial, interleaved, trial_of
from benchmarks.mutation.mutants import Mutant, StaleMutantError
from benchmarks.mutation.process import StackProcess
from benchmarks.mutation.runs import Run, kind_of, reasons
from benchmarks.mutation.trees import remove_tree
from benchmarks.mutation.worlds import Case

#: killable: fails by the copies' rule; survived: in no world; unreached: its lines run in no
#: world; stale: made for other sources
Status = Literal["killable", "survived", "unreached", "stale"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hunted:
    """What became of a mutant in the worlds of the benchmark."""

    mutant: str
    status: Status
    kind: str = ""  #: of the failure: crash, hang or behaviour
    case: str = ""  #: world in which it is killed
    why: tuple[str, ...] = ()  #: violated there, or crash, hang, costly_...
    copies: str = ""  #: of that world
    reached: int = 0  #: worlds in which its lines run, all for compiled code
    worlds: int = 0  #: in which it was run
    differing: int = 0  #: of them, those whose trace is not that of the sound stack
    knife_edges: tuple[str, ...] = ()  #: worlds in which it fails, but not by the copies' rule
    runs: int = 0
    cpu_s: float = 0.0  #: of the mutant's runs, without compiling
    compile_s: float = 0.0  #: of CPU
    wall_s: float = 0.0  #: in all
    error: str = ""  #: of a crash, or why it is stale


def hunt(bench: Bench, mutant: Mutant, sound: StackProcess, running: list[StackProcess]) -> Hunted:
    """Run a mutant until a failure is its doing for certain, or the worlds are used up."""
    began = time.monotonic()
    try:
        with trial_of(bench, mutant, sound, running) as trial:
            found = _hunt(trial, began)
    except StaleMutantError as error:
        return Hunted(mutant=mutant.id, status="stale", error=str(error))
    if found.status != "killable":  # no search needs what was compiled for it
        remove_tree(bench.trees, mutant)
    return found


def _hunt(trial: Trial, began: float) -> Hunted:
    reached = [case for case in trial.bench.cases if trial.reaches(_sound_run(trial, case))]
    worlds = differing = 0
    edges: list[str] = []
    killed: dict[str, object] = {}
    for case in interleaved(reached, trial.bench):
        if not _is_usable(trial, case):
            continue
        stack = case.stack
        run = trial.run(case.world, stack)
        worlds += 1
        differing += run.digest != _sound_run(trial, case).digest
        why = trial.why_failed(run, case.world, stack)
        if not why:
            continue
        told = trial.told(case.world, stack)
        if told.apart:
            killed = {"kind": kind_of(why), "case": case.name, "why": why, "copies": str(told)}
            killed["error"] = run.error
            break
        edges.append(case.name)
    status: Status = "killable" if killed else "survived" if reached else "unreached"
    return Hunted(
        mutant=trial.mutant.id,
        status=status,
        reached=len(reached),
        worlds=worlds,
        differing=differing,
        knife_edges=tuple(edges),
        runs=trial.runs,
        cpu_s=trial.cpu_s,
        compile_s=trial.compile_s,
        wall_s=time.monotonic() - began,
        **killed,  # type: ignore[arg-type]
    )


def _sound_run(trial: Trial, case: Case) -> Run:
    stack = case.stack
    return trial.bench.sound.run(trial.sound_process, case.world, stack, lines=True)


def _is_usable(trial: Trial, case: Case) -> bool:
    """Whether the sound stack keeps all specifications; a world where it does not tells little."""
    return not reasons(_sound_run(trial, case))
