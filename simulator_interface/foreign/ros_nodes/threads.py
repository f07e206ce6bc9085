"""``threading`` and ``time`` for the user's modules: fibres, and simulated time."""

from __future__ import annotations

import time as machine_time
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType, TracebackType
from typing import Any

from simulator_interface.foreign.ros_nodes import here
from simulator_interface.foreign.ros_nodes.fibres import LOOK, NS, Fibre, Latch
from simulator_interface.foreign.ros_nodes.missing import refusing


def _until(timeout: float | None) -> int | None:
    return None if timeout is None else here.timeline().now + max(0, int(timeout * NS))


class Thread:
    """A thread of a program, as ``threading.Thread``; an error in it ends it alone."""

    def __init__(
        self,
        group: None = None,
        target: Callable[..., object] | None = None,
        name: str | None = None,
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
        *,
        daemon: bool | None = None,
    ) -> None:
        self._target, self._args, self._kwargs = target, args, dict(kwargs or {})
        self.name, self.daemon = name or "Thread", bool(daemon)
        self._fibre: Fibre | None = None

    def run(self) -> None:
        """Do its work."""
        if self._target is not None:
            self._target(*self._args, **self._kwargs)

    def start(self) -> None:
        """Start it."""
        if self._fibre is not None:
            raise RuntimeError("threads can only be started once")
        program = here.program()

        def run() -> None:
            try:
                self.run()
            except Exception as error:
                program.log("error", self.name, f"thread ended by {type(error).__name__}: {error}")

        self._fibre = here.timeline().start(program, run)

    def is_alive(self) -> bool:
        """Tell whether it runs."""
        return self._fibre is not None and not self._fibre.is_finished

    def join(self, timeout: float | None = None) -> None:
        """Wait for its end."""
        if self._fibre is None:
            raise RuntimeError("cannot join thread before it is started")
        self._fibre.ended.wait(here.timeline(), _until(timeout))


class Event:
    """As ``threading.Event``."""

    def __init__(self) -> None:
        self._signal = Latch()

    def is_set(self) -> bool:
        """Tell whether it is set."""
        return self._signal.is_set

    def set(self) -> None:
        """Set it."""
        self._signal.set()

    def clear(self) -> None:
        """Unset it."""
        self._signal.clear()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is set."""
        return self._signal.wait(here.timeline(), _until(timeout))


class RLock:
    """As ``threading.RLock``."""

    is_reentrant = True

    def __init__(self) -> None:
        self._owner: Fibre | None = None
        self._depth = 0
        self._freed = Latch()

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Take it, waiting for it if ``blocking``."""
        timeline = here.timeline()
        fibre = timeline.current
        until = _until(timeout if timeout >= 0 else None)
        while self._depth and not (self.is_reentrant and self._owner is fibre):
            if not blocking or (until is not None and timeline.now >= until):
                return False
            self._freed.clear()
            self._freed.wait(timeline, until)
        self._owner, self._depth = fibre, self._depth + 1
        return True

    def release(self) -> None:
        """Give it back."""
        if not self._depth:
            raise RuntimeError("release unlocked lock")
        self._depth -= 1
        if not self._depth:
            self._owner = None
            self._freed.set()

    def locked(self) -> bool:
        """Tell whether it is taken."""
        return self._depth > 0

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()


class Lock(RLock):
    """As ``threading.Lock``."""

    is_reentrant = False


class Condition:
    """As ``threading.Condition``."""

    def __init__(self, lock: RLock | None = None) -> None:
        self._lock = lock or RLock()
        self.acquire, self.release = self._lock.acquire, self._lock.release
        self._waiting: list[Latch] = []

    def __enter__(self) -> bool:
        return self._lock.acquire()

    def __exit__(self, *error: object) -> None:
        self._lock.release()

    def wait(self, timeout: float | None = None) -> bool:
        """Give the lock back, wait to be notified, and take it again."""
        signal = Latch()
        self._waiting.append(signal)
        self._lock.release()
        try:
            return signal.wait(here.timeline(), _until(timeout))
        finally:
            if signal in self._waiting:
                self._waiting.remove(signal)
            self._lock.acquire()

    def wait_for(self, predicate: Callable[[], Any], timeout: float | None = None) -> Any:
        """Wait until something holds."""
        timeline, until = here.timeline(), _until(timeout)
        while not (held := predicate()) and (until is None or timeline.now < until):
            self.wait(None if until is None else (until - timeline.now) / NS)
        return held

    def notify(self, n: int = 1) -> None:
        """Wake ``n`` that wait."""
        for signal in self._waiting[:n]:
            self._waiting.remove(signal)
            signal.set()

    def notify_all(self) -> None:
        """Wake all that wait."""
        self.notify(len(self._waiting))


def threading_module() -> ModuleType:
    """Make what user code imports as ``threading``."""
    names = (Thread, Event, RLock, Lock, Condition)
    return refusing("threading", {kind.__name__: kind for kind in names})


def time_module() -> ModuleType:
    """Make what user code imports as ``time``."""

    def seconds() -> float:
        return here.timeline().now / NS

    def nanoseconds() -> int:
        return here.timeline().now

    def sleep(span: float) -> None:
        here.timeline().sleep(max(LOOK if span == 0 else 0, int(span * NS)))

    module = ModuleType("time")
    vars(module).update(vars(machine_time))
    for name in ("time", "monotonic", "perf_counter", "process_time", "thread_time"):
        setattr(module, name, seconds)
        setattr(module, f"{name}_ns", nanoseconds)
    module.sleep = sleep  # type: ignore[attr-defined]
    return module
