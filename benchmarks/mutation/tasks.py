"""Tasks on a few workers: threads that drive processes, so that Ctrl-C ends all of it at once."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from benchmarks.mutation.process import StackProcess, StoppedError

T = TypeVar("T")
R = TypeVar("R")
WAIT = 0.5  # s between two looks at Ctrl-C


@dataclass(slots=True)
class Worker:
    """What one worker has: a process with the sound stack, and all processes to be ended."""

    sound: StackProcess
    running: list[StackProcess] = field(default_factory=list)

    def stop(self) -> None:
        """Let every process end, and whoever waits for one."""
        for process in (self.sound, *self.running):
            process.stopped = True


@dataclass(slots=True)
class Tasks(Generic[T, R]):
    """Tasks that are worked off side by side, each result taken in the calling thread."""

    work: Callable[[T, Worker], R]
    keep: Callable[[T, R], str]  #: takes a result; gives a line about it
    title: str

    def run(self, tasks: Sequence[T], workers: Sequence[Worker]) -> None:
        """Work off all tasks.

        Args:
            tasks: in the order in which they begin.
            workers: one thread each.

        Raises:
            KeyboardInterrupt: Ctrl-C; all processes have been told to end.
            Exception: what a task raised.
        """
        waiting: queue.SimpleQueue[T] = queue.SimpleQueue()
        for task in tasks:
            waiting.put(task)
        done: queue.SimpleQueue[tuple[T, R | BaseException]] = queue.SimpleQueue()
        threads = [
            threading.Thread(target=self._serve, args=(waiting, done, worker), daemon=True)
            for worker in workers
        ]
        for thread in threads:
            thread.start()
        try:
            self._collect(len(tasks), done)
        except BaseException:
            for worker in workers:
                worker.stop()
            for thread in threads:
                thread.join()
            raise

    def _serve(
        self,
        waiting: queue.SimpleQueue[T],
        done: queue.SimpleQueue[tuple[T, R | BaseException]],
        worker: Worker,
    ) -> None:
        while not worker.sound.stopped:
            try:
                task = waiting.get_nowait()
            except queue.Empty:
                return
            try:
                done.put((task, self.work(task, worker)))
            except StoppedError:
                return
            except Exception as error:
                done.put((task, error))
                return
            worker.running.clear()

    def _collect(self, count: int, done: queue.SimpleQueue[tuple[T, R | BaseException]]) -> None:
        began = time.monotonic()
        for number in range(1, count + 1):
            task, result = self._next(done)
            if isinstance(result, BaseException):
                raise result
            line = self.keep(task, result)
            left = (time.monotonic() - began) / number * (count - number)
            about = f"about {left / 60.0:.0f} min left" if number < count else "done"
            print(f"{self.title} {number}/{count}  {line}  {about}", file=sys.stderr, flush=True)

    @staticmethod
    def _next(
        done: queue.SimpleQueue[tuple[T, R | BaseException]],
    ) -> tuple[T, R | BaseException]:
        while True:
            try:
                return done.get(timeout=WAIT)
            except queue.Empty:
                continue
