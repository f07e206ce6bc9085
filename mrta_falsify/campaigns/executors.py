"""Where trials run: in this process, or in worker processes of this machine.

An executor takes jobs and gives back what became of them, in any order; the runner puts
them in order. A job is ``{"number": n, "u": [...]}``, the outcome a record as JSON-shaped
data. Executors know neither samplers nor stores.
"""

from __future__ import annotations

import collections
import contextlib
import importlib
import json
import os
import selectors
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from mrta_falsify.campaigns.settings import TARGETS, CampaignSettings
from mrta_falsify.core import codec
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.durable import place_error_in
from mrta_falsify.core.errors import HarnessError, InputError, PlaceError
from mrta_falsify.core.interruption import is_interruption
from mrta_falsify.core.modules import is_ours, look_here_for, python_command
from mrta_falsify.core.process_clock import ProcessClock

Job = dict[str, Any]
#: runs one job; raises only if the toolkit itself fails
Trial = Callable[[Job], dict[str, Any]]

MAX_DEATHS = 3  # in the same way, one after the other, of workers that are not ready
MAX_STARTS = 12  # of one worker, in whatever way it dies before it is ready
LAST_WORDS = 4096  # bytes of what a worker said before it died
STDERR = 2  # file descriptor
START_LIMIT = 300.0  # s for a worker to import and compile, of its own work and sleep
LOOK_EVERY = 0.25  # s between two looks at the clocks of workers
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Finished:
    """What became of one job."""

    number: int
    #: all but ``ok`` are no fault of the stack; ``refused``: the user's input is wrong;
    #: ``unwritable``: a file could not be written, see :class:`~..core.errors.PlaceError`
    fate: Literal["ok", "crashed", "timeout", "refused", "unwritable"]
    record: dict[str, Any] | None = None  #: for ok
    error: str = ""  #: otherwise


def open_target(settings: CampaignSettings) -> Trial:
    """Open the function that runs trials; what can be compiled once is compiled here.

    Raises:
        InputError: the scenario does not compile or has changed.
    """
    module, _, name = TARGETS.get(settings.target, settings.target).partition(":")
    if not is_ours(module):
        look_here_for(module)
    opened: Trial = getattr(importlib.import_module(module), name)(settings.trials)
    return opened


# --- here --------------------------------------------------------------------------------


class SerialExecutor:
    """Runs each job in this process when it is collected; no time limit, no rescue."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        del options
        self._trial: Trial | None = None
        self._jobs: collections.deque[Job] = collections.deque()

    def open(self, settings: CampaignSettings) -> None:
        """Compile."""
        self._trial = open_target(settings)

    def submit(self, job: Job) -> None:
        """Take a job."""
        self._jobs.append(job)

    def collect(self, timeout: float) -> tuple[Finished, ...]:
        """Run the oldest job."""
        del timeout
        if self._trial is None:
            raise HarnessError("the executor is not open")
        if not self._jobs:
            return ()
        job = self._jobs.popleft()
        try:
            return (Finished(number=job["number"], fate="ok", record=self._trial(job)),)
        except InputError as error:
            return (Finished(number=job["number"], fate="refused", error=str(error)),)
        except Exception as error:
            if is_interruption(error):
                raise KeyboardInterrupt from error
            if place := place_error_in(error):
                return (Finished(number=job["number"], fate="unwritable", error=str(place)),)
            text = traceback.format_exc()
            return (Finished(number=job["number"], fate="crashed", error=text),)

    def close(self) -> None:
        """Forget all jobs."""
        self._jobs.clear()


# --- local processes -----------------------------------------------------------------------


@dataclass(slots=True)
class _Worker:
    """One worker process and the job it has."""

    process: subprocess.Popen[bytes]
    clock: ProcessClock  #: of its start, or of its job
    results: int  #: file descriptor
    buffer: bytearray = field(default_factory=bytearray)
    ready: bool = False
    job: Job | None = None
    served: int = 0  #: jobs done
    output_fd: int = -1  #: file descriptor of what it says on stderr until it is ready
    deaths: tuple[str, ...] = ()  #: how those ended that it replaces, before they were ready

    def begin_limit(self) -> None:
        """Begin the time limit of its job, which may have begun before."""
        self.clock.restart()
        self.clock.look()

    def send(self, message: Any) -> None:
        """Send a line to the worker; a worker that has died is noticed when it is read."""
        if self.process.stdin is None:
            raise HarnessError("a worker has no stdin")
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(json.dumps(message).encode() + b"\n")
            self.process.stdin.flush()

    def kill(self) -> None:
        """End the process for good."""
        self.process.kill()
        self.process.wait()
        if self.process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self.process.stdin.close()
        os.close(self.results)
        os.close(self.output_fd)

    def words(self) -> bytes:
        """Give the end of what it has said before it was ready."""
        size = os.fstat(self.output_fd).st_size
        return os.pread(self.output_fd, LAST_WORDS, max(0, size - LAST_WORDS))


class ProcessExecutor:
    """Worker processes that compile once each; a crash or a hang costs one job.

    Workers are started anew (never forked), speak lines of JSON over pipes, end themselves
    when the parent is gone, and are replaced after ``recycle`` jobs.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`ProcessExecutor`."""

        workers: int = quantity(low=1, high=512, default=1)
        recycle: int = quantity(low=1, default=200)  #: jobs per process

    def __init__(self, options: Options) -> None:
        self._options = options
        self._settings: CampaignSettings | None = None
        self._workers: list[_Worker] = []
        self._waiting: collections.deque[Job] = collections.deque()
        self._selector = selectors.DefaultSelector()
        self._looked = 0.0  # at the clocks, monotonic [s]

    def open(self, settings: CampaignSettings) -> None:
        """Start the workers."""
        self._settings = settings
        for _ in range(self._options.workers):
            self._start()

    def submit(self, job: Job) -> None:
        """Take a job."""
        self._waiting.append(job)
        self._hand_out()

    def collect(self, timeout: float) -> tuple[Finished, ...]:
        """Wait up to ``timeout`` [s] for jobs to end.

        Raises:
            InputError: a worker cannot open the scenario.
            PlaceError: a worker cannot open the campaign's directory.
            HarnessError: workers cannot be started.
        """
        self._hand_out()
        done: list[Finished] = []
        for key, _ in self._selector.select(timeout):
            done += self._read(key.data)
        done += self._overdue()
        self._hand_out()
        return tuple(done)

    def close(self) -> None:
        """Kill all workers."""
        for worker in list(self._workers):
            self._drop(worker)
        self._waiting.clear()
        self._selector.close()

    # --- workers -------------------------------------------------------------------------

    def _start(self, deaths: tuple[str, ...] = ()) -> None:
        if self._settings is None:
            raise HarnessError("the executor is not open")
        read_end, write_end = os.pipe()
        output_fd, ours = os.memfd_create("said"), os.dup(STDERR)
        process = subprocess.Popen(
            python_command(
                "mrta_falsify.campaigns.worker_process",
                str(write_end),
                str(os.getpid()),
                str(ours),
            ),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=output_fd,
            pass_fds=(write_end, ours),
            env={**os.environ, **ONE_THREAD},
            start_new_session=True,  # Ctrl-C is the parent's business
        )
        os.close(write_end)
        os.close(ours)
        clock = ProcessClock(process.pid)
        clock.look()
        worker = _Worker(
            process=process, clock=clock, results=read_end, output_fd=output_fd, deaths=deaths
        )
        worker.send(codec.encode(self._settings))
        self._workers.append(worker)
        self._selector.register(read_end, selectors.EVENT_READ, worker)

    def _drop(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        self._selector.unregister(worker.results)
        worker.kill()

    def _replace(self, worker: _Worker) -> None:
        self._drop(worker)
        self._start()

    def _hand_out(self) -> None:
        for worker in self._workers:
            if not self._waiting:
                return
            if worker.ready and worker.job is None:
                worker.job = self._waiting.popleft()
                worker.begin_limit()
                worker.send(worker.job)

    def _read(self, worker: _Worker) -> list[Finished]:
        data = os.read(worker.results, 1 << 20)
        if not data:
            return self._died(worker)
        worker.buffer += data
        done = []
        while b"\n" in worker.buffer:
            line, _, rest = bytes(worker.buffer).partition(b"\n")
            worker.buffer = bytearray(rest)
            done += self._message(worker, json.loads(line))
        return done

    def _message(self, worker: _Worker, message: dict[str, Any]) -> list[Finished]:
        if "refused" in message and not worker.ready:
            raise InputError(message["refused"])
        if "unwritable" in message and not worker.ready:
            raise PlaceError(message["unwritable"])
        if "ready" in message:
            worker.ready, worker.deaths = True, ()
            sys.stderr.write(worker.words().decode(errors="replace"))
            return []
        if "limit" in message:
            worker.begin_limit()
            return []
        job, worker.job = worker.job, None
        if job is None or job["number"] != message["number"]:
            raise HarnessError(
                f"a worker answered for trial {message['number']}, which was not assigned to it"
            )
        worker.served += 1
        if worker.served >= self._options.recycle:
            self._replace(worker)
        if "crashed" in message:
            return [Finished(number=job["number"], fate="crashed", error=message["crashed"])]
        if "refused" in message:
            return [Finished(number=job["number"], fate="refused", error=message["refused"])]
        if "unwritable" in message:
            text = message["unwritable"]
            return [Finished(number=job["number"], fate="unwritable", error=text)]
        return [Finished(number=job["number"], fate="ok", record=message["record"])]

    def _died(self, worker: _Worker) -> list[Finished]:
        code = worker.process.wait()
        job = worker.job
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        deaths = () if worker.ready else (*worker.deaths, how)
        words = worker.words().decode(errors="replace")
        self._drop(worker)
        if deaths[-MAX_DEATHS:] == (how,) * MAX_DEATHS or len(deaths) == MAX_STARTS:
            raise _never_ready(deaths, words)
        self._start(deaths)
        if job is None:
            return []
        return [Finished(number=job["number"], fate="crashed", error=f"worker ended by {how}")]

    def _overdue(self) -> list[Finished]:
        if self._settings is None:
            return []
        now = time.monotonic()
        if now - self._looked < LOOK_EVERY:
            return []
        self._looked = now
        done = []
        for worker in list(self._workers):
            job = worker.job
            if worker.ready and job is None:
                continue
            spent = worker.clock.look()
            if not worker.ready and spent > START_LIMIT:
                raise HarnessError(f"a worker was not ready after {START_LIMIT:.0f} s")
            if job is not None and spent > self._settings.time_limit:
                self._replace(worker)
                text = f"killed after {self._settings.time_limit:g} s of work and sleep"
                done.append(Finished(number=job["number"], fate="timeout", error=text))
        return done


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
