"""What stages of a run cost, by methods that are timed while it runs."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Stopwatch:
    """Adds up the time that stages take, without that of the stages they call."""

    clock: Callable[[], float] = time.perf_counter  #: gives seconds
    seconds: dict[str, float] = field(default_factory=dict)
    calls: Counter[str] = field(default_factory=Counter)
    _inner: float = 0.0  #: spent in stages that the present one called [s]

    @contextlib.contextmanager
    def watching(self, owner: type, method: str, name: str) -> Iterator[None]:
        """Time a method of a class meanwhile, as (a part of) stage ``name``."""
        own = vars(owner).get(method)
        setattr(owner, method, self._timed(getattr(owner, method), name))
        self.seconds.setdefault(name, 0.0)
        try:
            yield
        finally:
            if own is None:
                delattr(owner, method)
            else:
                setattr(owner, method, own)

    def _timed(self, method: Callable[..., Any], name: str) -> Callable[..., Any]:
        def timed(*args: Any, **named: Any) -> Any:
            outer, self._inner = self._inner, 0.0
            before = self.clock()
            try:
                return method(*args, **named)
            finally:
                spent = self.clock() - before
                self.seconds[name] += spent - self._inner
                self.calls[name] += 1
                self._inner = outer + spent

        return timed
