"""Where trials run: in this process, or in worker processes of this machine.

An executor takes jobs and gives back what became of them, in any order; the runner puts
them in order. A job is ``{"number": n, "u": [...]}``, the outcome a record as JSON-shaped
data. Executors know neither samplers nor stores.
"""

from __future__ import annotations

import collections
import functools
import importlib
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from mrta_falsify.campaigns.settings import TARGETS, CampaignSettings
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.durable import place_error_in
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.core.interruption import is_interruption
from mrta_falsify.core.modules import is_ours, look_here_for
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.ending import Ending, opened
from mrta_falsify.process.pool import Done, Pool

Job = dict[str, Any]
#: runs one job; raises only if the toolkit itself fails
Trial = Callable[[Job], dict[str, Any]]


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
    trial: Trial = getattr(importlib.import_module(module), name)(settings.trials)
    return trial


def _finished(trial: Trial, job: Job) -> Finished:
    """Run one job, and say what became of it."""
    number = job["number"]
    try:
        return Finished(number=number, fate="ok", record=trial(job))
    except InputError as error:
        return Finished(number=number, fate="refused", error=str(error))
    except Exception as error:
        if is_interruption(error):
            raise KeyboardInterrupt from error
        if place := place_error_in(error):
            return Finished(number=number, fate="unwritable", error=str(place))
        return Finished(number=number, fate="crashed", error=traceback.format_exc())


class SerialExecutor:
    """Runs each job in this process when it is collected; no time limit, no rescue."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """No options."""

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
        return (_finished(self._trial, self._jobs.popleft()),)

    def close(self) -> None:
        """Forget all jobs."""
        self._jobs.clear()


class ProcessExecutor:
    """Worker processes that compile once each; a crash or a hang costs one job.

    They are those of a :class:`~mrta_falsify.process.pool.Pool`, replaced after ``recycle`` jobs.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`ProcessExecutor`."""

        workers: int = quantity(low=1, high=512, default=1)
        recycle: int = quantity(low=1, default=200)  #: jobs per process

    def __init__(self, options: Options) -> None:
        self._options = options
        self._pool: Pool | None = None

    @property
    def pool(self) -> Pool:
        """Its workers.

        Raises:
            HarnessError: it is not open.
        """
        if self._pool is None:
            raise HarnessError("the executor is not open")
        return self._pool

    def open(self, settings: CampaignSettings) -> None:
        """Make ready; each worker starts when there is work for it."""
        self._pool = Pool(
            functools.partial(_open_worker, settings),
            workers=self._options.workers,
            budget=Budget(work=settings.time_limit),
            recycle=self._options.recycle,
            is_quiet=True,
        )

    def submit(self, job: Job) -> None:
        """Take a job."""
        self.pool.submit(job["number"], job)

    def collect(self, timeout: float) -> tuple[Finished, ...]:
        """Wait up to ``timeout`` [s] for jobs to end.

        Raises:
            InputError: a worker cannot open the scenario.
            PlaceError: a worker cannot open the campaign's directory.
            HarnessError: workers cannot be started.
        """
        return tuple(map(_fate, self.pool.collect(timeout)))

    def close(self) -> None:
        """Kill all workers."""
        if self._pool is not None:
            self._pool.close()


def _open_worker(settings: CampaignSettings) -> Callable[[Job], Finished]:
    return functools.partial(_finished, open_target(settings))


def _fate(done: Done) -> Finished:
    match done.outcome:
        case Ending(kind="hang", text=text):
            return Finished(number=done.key, fate="timeout", error=text)
        case Ending(text=text):
            return Finished(number=done.key, fate="crashed", error=f"worker {text}")
        case outcome:
            finished: Finished = opened(outcome)
            return finished
