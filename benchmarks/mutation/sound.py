"""What the sound stack does in each world: run once, for all mutants."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.mutation.process import StackProcess, StoppedError, expected
from benchmarks.mutation.runs import Run, reasons
from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import World

UNKNOWN = 300.0  # s of CPU for the first run of a world


@dataclass(slots=True)
class SoundRuns:
    """Runs of the sound stack by world, on disc before they are used.

    Args:
        path: of the file.
        specifications: that judge.
        code: digest of the sound stack's tree; runs of other code are made again.
    """

    path: Path
    specifications: tuple[str, ...]
    code: str = ""
    _journal: RunJournal[Run] = field(init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self._journal = RunJournal(Run, self.path, code=self.code)

    def known(self, world: World, stack: StackConfig) -> Run | None:
        """Look up the run of a world."""
        return self._journal.answers.get(self._key(world, stack))

    def run(
        self, process: StackProcess, world: World, stack: StackConfig, *, lines: bool = False
    ) -> Run:
        """Look up the run of a world, or make it.

        Args:
            process: with the sound stack.
            world: to run.
            stack: its layers.
            lines: the lines that run must be known as well.

        Raises:
            HarnessError: the sound stack crashed or hung.
        """
        found = self.known(world, stack)
        if found is not None and (found.lines or not lines):
            return found
        data: dict[str, Any] = codec.encode(world)
        found = process.run(data, stack, self.specifications, cpu_s=UNKNOWN, lines=lines)
        expected({"fate": found.fate, "error": found.error}, world.name)
        if process.stopped:
            raise StoppedError
        with self._lock:
            self._journal.keep(self._key(world, stack), found)
        return found

    def fails(self, process: StackProcess, world: World, stack: StackConfig) -> bool:
        """Whether the sound stack fails in a world."""
        return bool(reasons(self.run(process, world, stack)))

    def _key(self, world: World, stack: StackConfig) -> str:
        told = codec.digest({"stack": stack, "specifications": self.specifications})
        return f"{world.digest()}/{told[:12]}"
