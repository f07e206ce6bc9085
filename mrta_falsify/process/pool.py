"""A pool of fresh processes: each is opened once, and then runs one job after the other.

Workers are started anew (never forked). They do not hear Ctrl-C, end with this process however it
ends, and cost no more than their job when they crash or hang. What is sent to them, and comes back,
must be such as ``multiprocessing`` can send.
"""

from __future__ import annotations

import collections
import contextlib
import itertools
import json
import os
import selectors
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.reduction import ForkingPickler
from typing import Any, NamedTuple

from mrta_falsify.core.errors import HarnessError, InputError, PlaceError
from mrta_falsify.core.garbage import collect_seldom
from mrta_falsify.process.budget import Budget, on_credit
from mrta_falsify.process.child import Child, spawn
from mrta_falsify.process.ending import (
    Ending,
    Outcome,
    Raised,
    Returned,
    name_of_ending,
    opened,
)
from mrta_falsify.process.usage import ProcessClock

#: opens what runs jobs; it is called once in each worker
Begin = Callable[[], Callable[[Any], Any]]

MAX_DEATHS = 3  # of workers with the same job; or in the same way in a row, before they are ready
MAX_STARTS = 12  # of one worker, in whatever way it dies before it is ready
LAST_WORDS = 4096  # bytes of what a worker said before it died
STDERR = 2  # file descriptor
LOOK_EVERY = 0.25  # s between two looks at the clocks of workers
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
BOOT = """\
import json, sys
sys.path[:] = json.loads(sys.argv[1])
parent, descriptor, stderr = map(int, sys.argv[2:])
from mrta_falsify.process.parent import end_with
end_with(parent)
from mrta_falsify.process.pool import serve
serve(descriptor, stderr)
"""
_SIZE = struct.Struct("<Q")


class Done(NamedTuple):
    """What became of one job."""

    key: Any
    outcome: Outcome | Ending  #: an ending: the worker ended, or was ended, with the job


@dataclass(slots=True)
class _Worker:
    """One worker and the job it has."""

    child: Child
    clock: ProcessClock  #: of its start, or of its job
    link: socket.socket
    said: int  #: file descriptor of what it says on stderr until it is ready
    deaths: tuple[str, ...] = ()  #: how those ended that it replaces, before they were ready
    buffer: bytearray = field(default_factory=bytearray)
    ready: bool = False
    job: tuple[Any, Any] | None = None  #: with its key
    served: int = 0  #: jobs done

    def credit(self) -> None:
        """Begin the budget of its job, which may have begun before."""
        self.clock.restart()
        self.clock.look()

    def close(self) -> None:
        """End it, and all that it has started."""
        self.child.kill(self.clock.alive)
        self.link.close()
        os.close(self.said)

    def words(self) -> str:
        """Give the end of what it has said before it was ready."""
        size = os.fstat(self.said).st_size
        return os.pread(self.said, LAST_WORDS, max(0, size - LAST_WORDS)).decode(errors="replace")


class Pool(contextlib.AbstractContextManager["Pool"]):
    """Runs jobs in workers; its workers end with the block that it is opened in.

    Args:
        begin: called in each worker; returns what runs a job there.
        workers: at most; each starts when there is work for it.
        budget: of a worker: its start, and the work and sleep of each job.
        recycle: jobs of one worker, which is then replaced; None: any number.
        is_quiet: whether what is printed to stdout is dropped.
    """

    def __init__(
        self,
        begin: Begin,
        *,
        workers: int = 1,
        budget: Budget | None = None,
        recycle: int | None = None,
        is_quiet: bool = False,
    ) -> None:
        self._begin, self._most, self._recycle = begin, workers, recycle
        self._budget = budget or Budget()
        self._stdout = subprocess.DEVNULL if is_quiet else None
        self.workers: list[_Worker] = []
        self._waiting: collections.deque[tuple[Any, Any]] = collections.deque()
        self._selector = selectors.DefaultSelector()
        self._looked = 0.0  # at the clocks, monotonic [s]
        self._keys = itertools.count()  # of jobs of `unordered`

    def __exit__(self, *error: object) -> None:
        self.close()

    def submit(self, key: Any, job: Any) -> None:
        """Take a job."""
        self._waiting.append((key, job))
        busy = sum(worker.job is not None for worker in self.workers)
        if len(self.workers) < min(self._most, busy + len(self._waiting)):
            self._start()
        self._hand_out()

    def collect(self, timeout: float) -> list[Done]:
        """Wait up to ``timeout`` [s] for jobs to end.

        Raises:
            InputError: a worker cannot be opened: the user's input is wrong.
            PlaceError: a worker cannot be opened: a file cannot be written.
            HarnessError: workers cannot be started.
        """
        self._hand_out()
        done: list[Done] = []
        for key, _ in self._selector.select(timeout):
            done += self._read(key.data)
        done += self._overdue()
        self._hand_out()
        return done

    def unordered(self, jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """Run jobs; give number and result of each as it comes. Lost jobs are run again.

        Raises:
            Ending: three workers have ended with the same job.
            Exception: what a job raised.
        """
        numbers = {next(self._keys): number for number in range(len(jobs))}
        for key, number in numbers.items():
            self.submit(key, jobs[number])
        deaths: collections.Counter[int] = collections.Counter()
        try:
            while numbers:
                for key, outcome in self.collect(LOOK_EVERY):
                    if isinstance(outcome, Ending):
                        deaths[key] += 1
                        if deaths[key] == MAX_DEATHS:
                            raise outcome
                        self.submit(key, jobs[numbers[key]])
                    else:
                        yield numbers.pop(key), opened(outcome)
        finally:
            self._forget(numbers)

    def close(self) -> None:
        """Kill all workers."""
        for worker in list(self.workers):
            self._drop(worker)
        self._waiting.clear()
        self._selector.close()

    # --- workers -------------------------------------------------------------------------

    def _start(self, deaths: tuple[str, ...] = ()) -> None:
        ours, theirs = socket.socketpair()
        said, stderr = _unnamed_file(), os.dup(STDERR)
        descriptors = (theirs.fileno(), stderr)
        arguments = [json.dumps(sys.path), *map(str, (os.getpid(), *descriptors))]
        child = spawn(
            [sys.executable, "-P", "-c", BOOT, *arguments],
            environment={**os.environ, **ONE_THREAD},
            passed=descriptors,
            stdout=self._stdout,
            stderr=said,
        )
        theirs.close()
        os.close(stderr)
        worker = _Worker(child, ProcessClock(child.number), ours, said, deaths)
        worker.credit()
        self.workers.append(worker)
        self._selector.register(ours, selectors.EVENT_READ, worker)
        _send(ours, self._begin)

    def _drop(self, worker: _Worker) -> None:
        self.workers.remove(worker)
        self._selector.unregister(worker.link)
        worker.close()

    def _replace(self, worker: _Worker) -> None:
        self._drop(worker)
        self._start()

    def _forget(self, keys: Sequence[int] | dict[int, int]) -> None:
        """Drop jobs that nobody waits for any more."""
        waiting = [row for row in self._waiting if row[0] not in keys]
        self._waiting = collections.deque(waiting)
        for worker in list(self.workers):
            if worker.job is not None and worker.job[0] in keys:
                self._drop(worker)

    def _hand_out(self) -> None:
        for worker in self.workers:
            if not self._waiting:
                return
            if worker.ready and worker.job is None:
                worker.job = self._waiting.popleft()
                worker.credit()
                _send(worker.link, worker.job[1])

    def _read(self, worker: _Worker) -> list[Done]:
        try:
            data = worker.link.recv(1 << 20)
        except ConnectionResetError:
            data = b""
        if not data:
            return self._died(worker)
        worker.buffer += data
        done = []
        while (message := _taken(worker.buffer)) is not None:
            done += self._message(worker, message)
        return done

    def _message(self, worker: _Worker, message: Outcome | str) -> list[Done]:
        if message == "credit":
            worker.credit()
            return []
        assert not isinstance(message, str)
        if not worker.ready:
            opened(message)
            worker.ready, worker.deaths = True, ()
            sys.stderr.write(worker.words())
            return []
        job, worker.job = worker.job, None
        assert job is not None
        worker.served += 1
        if worker.served == self._recycle:
            self._replace(worker)
        return [Done(job[0], message)]

    def _died(self, worker: _Worker) -> list[Done]:
        code = worker.child.code(wait=True) or 0
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        deaths = () if worker.ready else (*worker.deaths, how)
        words = worker.words()
        self._drop(worker)
        if deaths[-MAX_DEATHS:] == (how,) * MAX_DEATHS or len(deaths) == MAX_STARTS:
            raise _never_ready(deaths, words)
        self._start(deaths)
        if worker.job is None:
            return []
        return [Done(worker.job[0], Ending("crash", f"ended by {how}", cause=name_of_ending(code)))]

    def _overdue(self) -> list[Done]:
        now = time.monotonic()
        if now - self._looked < LOOK_EVERY:
            return []
        self._looked = now
        done = []
        for worker in list(self.workers):
            if worker.ready and worker.job is None:
                continue
            spent = worker.clock.look()
            if not worker.ready and spent > self._budget.start:
                raise HarnessError(f"a worker was not ready after {self._budget.start:.0f} s")
            if worker.job is not None and spent > self._budget.work:
                self._replace(worker)
                text = f"killed after {self._budget.work:g} s of work and sleep"
                done.append(Done(worker.job[0], Ending("hang", text)))
        return done


def _unnamed_file() -> int:
    """Open a file that goes with its last descriptor; in memory, where the system can."""
    if sys.platform == "linux":
        return os.memfd_create("said")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


def _never_ready(deaths: tuple[str, ...], words: str) -> HarnessError:
    """Say how a worker died each time before it was ready.

    Args:
        deaths: how, the last one last.
        words: what the last one said.
    """
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    error = HarnessError(
        f"a worker ended by {deaths[-1]} before it was ready, for the "
        f"{len(deaths)}. time in a row; its last words: {lines[-1] if lines else 'none'}"
    )
    error.add_note(words)
    return error


# --- messages: a size, and what multiprocessing makes of a value ---------------------------------


def _send(link: socket.socket, value: Any) -> None:
    """Send a value to a worker; one that has died is noticed when it is read."""
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        _send_bytes(link, ForkingPickler.dumps(value))


def _send_bytes(link: socket.socket, body: bytes | memoryview) -> None:
    link.sendall(_SIZE.pack(len(body)) + bytes(body))


def _taken(buffer: bytearray) -> Any:
    """Take the first value from what has come; None: it is not complete."""
    if len(buffer) < _SIZE.size:
        return None
    end = _SIZE.size + _SIZE.unpack_from(buffer)[0]
    if len(buffer) < end:
        return None
    value = ForkingPickler.loads(buffer[_SIZE.size : end])
    del buffer[:end]
    return value


# --- in a worker -------------------------------------------------------------------------------


def serve(descriptor: int, stderr: int) -> None:
    """Run jobs until the parent closes the connection, or ends.

    Args:
        descriptor: of the connection.
        stderr: file descriptor of the parent's stderr, which becomes ours once this one is ready.
    """
    collect_seldom()
    link = socket.socket(fileno=descriptor)
    buffer = bytearray()

    def received() -> Any:
        while (value := _taken(buffer)) is None:
            data = link.recv(1 << 20)
            if not data:
                sys.exit()
            buffer.extend(data)
        return value

    try:
        run = received()()
    except (InputError, PlaceError) as error:
        _send_bytes(link, ForkingPickler.dumps(Raised.by(error)))
        return
    _send_bytes(link, ForkingPickler.dumps(Returned(None)))
    os.dup2(stderr, STDERR)  # until here the parent has kept what was said
    os.close(stderr)
    on_credit(lambda: _send_bytes(link, ForkingPickler.dumps("credit")))
    while True:
        job = received()
        try:  # a KeyboardInterrupt is no Ctrl-C here: it ends this worker, and nothing else
            outcome: Outcome = Returned(run(job))
        except Exception as error:
            outcome = Raised.by(error)
        sys.stdout.flush()
        try:
            body = ForkingPickler.dumps(outcome)
        except Exception as error:
            body = ForkingPickler.dumps(Raised.unsendable(error, outcome))
        _send_bytes(link, body)
