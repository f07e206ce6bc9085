"""How many runs an explanation has spent."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(slots=True)
class RunCount:
    """Counts runs and tells the caller."""

    most: int
    expected: int  #: in all
    on_done: Callable[[int, int], None]
    done: int = 0

    @property
    def left(self) -> int:
        """Runs that are allowed still."""
        return self.most - self.done

    def add(self) -> None:
        """Count one run."""
        self.done += 1
        self.expected = max(self.expected, self.done)
        self.on_done(self.done, self.expected)

    def each(self, runs: Iterable[T]) -> Iterator[T]:
        """Count each of ``runs`` as it ends."""
        for run in runs:
            self.add()
            yield run
