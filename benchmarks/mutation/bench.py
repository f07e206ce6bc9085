"""What all tasks of a benchmark share, and the mutant that one of them is at."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.copies import Told, told_apart
from benchmarks.mutation.lines import always_runs
from benchmarks.mutation.mutants import Mutant
from benchmarks.mutation.process import StackProcess
from benchmarks.mutation.runs import Run, reasons
from benchmarks.mutation.sound import SoundRuns
from benchmarks.mutation.trees import mutated_tree, sound_tree
from benchmarks.mutation.worlds import Case
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import World

#: CPU time after which a mutant hangs: so much, and so many times what the sound stack took
HANGS_AFTER, TIMES_SOUND = 20.0, 10.0  # s
RECENT = 8  # runs remembered: a world and its copies, which a sampler is told of as well


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """A benchmark's directory, opened."""

    directory: Path
    cases: tuple[Case, ...]
    sound: SoundRuns

    @property
    def trees(self) -> Path:
        """Folder of the trees of sources."""
        return self.directory / "trees"

    def sound_process(self) -> StackProcess:
        """Make a process for the sound stack."""
        return StackProcess(self.trees, sound_tree(self.trees), is_watching=True)


@dataclass(slots=True, kw_only=True)
class Trial:
    """A mutant and the sound stack beside each other; counts what the mutant's runs took."""

    bench: Bench
    mutant: Mutant
    sound_process: StackProcess
    process: StackProcess
    runs: int = 0
    cpu_s: float = 0.0
    compile_s: float = 0.0
    reached_everywhere: bool = field(init=False)
    _recent: dict[tuple[str, str], Run] = field(default_factory=dict)

    def __post_init__(self) -> None:
        tree = sound_tree(self.bench.trees)
        self.reached_everywhere = any(
            always_runs(edit.lines, ast.parse((tree / edit.path).read_text(encoding="utf-8")))
            for edit in self.mutant.edits
        )

    def reaches(self, sound: Run) -> bool:
        """Whether the mutant can make a difference to a run of the sound stack."""
        return self.reached_everywhere or any(
            not set(edit.lines).isdisjoint(sound.lines.get(edit.path, ()))
            for edit in self.mutant.edits
        )

    def run(self, world: World, stack: StackConfig) -> Run:
        """Run the mutant in a world, unless that was one of the last."""
        key = (world.digest(), stack.digest())
        if key in self._recent:
            return self._recent[key]
        known = self.bench.sound.known(world, stack)
        cpu_s = HANGS_AFTER + TIMES_SOUND * (known.cpu_s if known else 2.0)
        specifications = self.bench.sound.specifications
        found = self.process.run(codec.encode(world), stack, specifications, cpu_s=cpu_s)
        self.runs += 1
        self.cpu_s += found.cpu_s
        self.compile_s += found.compile_s
        while len(self._recent) >= RECENT:
            self._recent.pop(next(iter(self._recent)))
        self._recent[key] = found
        return found

    def why_failed(self, run: Run, world: World, stack: StackConfig) -> tuple[str, ...]:
        """List why a run of the mutant is a failure, needless costs included."""
        return reasons(run) or reasons(run, self.sound(world, stack))

    def sound(self, world: World, stack: StackConfig) -> Run:
        """Run the sound stack in a world, or look it up."""
        return self.bench.sound.run(self.sound_process, world, stack)

    def told(self, world: World, stack: StackConfig) -> Told:
        """Ask copies of a world whether a failure in it is the mutant's doing."""

        def fails(copy: World) -> bool:
            return bool(self.why_failed(self.run(copy, stack), copy, stack))

        def sound_fails(copy: World) -> bool:
            return bool(reasons(self.sound(copy, stack)))

        return told_apart(world, changed=fails, sound=sound_fails)


@contextmanager
def trial_of(
    bench: Bench, mutant: Mutant, sound_process: StackProcess, running: list[StackProcess]
) -> Iterator[Trial]:
    """Open a mutant, and close its process at the end.

    Args:
        bench: that it belongs to.
        mutant: to open.
        sound_process: of this worker.
        running: takes the mutant's process, so that an interruption can end it.

    Raises:
        StaleMutantError: it was made for other sources.
    """
    process = StackProcess(bench.trees, mutated_tree(bench.trees, mutant))
    running.append(process)
    with process:
        yield Trial(bench=bench, mutant=mutant, sound_process=sound_process, process=process)


def interleaved(cases: Sequence[Case], bench: Bench) -> list[Case]:
    """Order cases: in turn one of each source, quick sources first, each one's quick worlds first.

    The order depends on seconds that were measured once, with the sound stack.
    """
    seconds = {case.name: _seconds(case, bench) for case in cases}
    sources: dict[str, list[Case]] = {}
    for case in sorted(cases, key=lambda case: seconds[case.name]):
        sources.setdefault(case.source, []).append(case)
    turns = [
        (turn, place, case)
        for place, of in enumerate(sources.values())
        for turn, case in enumerate(of)
    ]
    return [case for _, _, case in sorted(turns, key=lambda item: item[:2])]


def _seconds(case: Case, bench: Bench) -> float:
    known = bench.sound.known(case.world, case.stack)
    return known.cpu_s if known else 0.0
