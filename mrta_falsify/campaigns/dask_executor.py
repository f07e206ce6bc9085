"""Trials on a Dask cluster, for campaigns that outgrow one machine (extra ``dask``).

Dask carries jobs to its workers and results back. On a worker, a job runs in a child process
of :class:`~mrta_falsify.campaigns.executors.ProcessExecutor`, as on one machine. It is compiled
once and killed when its time is up, and a crash costs one trial and not the worker.
"""

from __future__ import annotations

import gc
import queue
import signal
import threading
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any, cast

import dask
import distributed

from mrta_falsify.campaigns.executors import Finished, Job, ProcessExecutor
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core import codec
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError, HarnessError, InputError, PlaceError
from mrta_falsify.core.interruption import signals_held
from mrta_falsify.core.modules import forget_safe_path, safe_path

LOOPBACK = "127.0.0.1"
CHILD_TIMEOUT = 1.0  # s between two looks at the child process
SCHEDULER_TIMEOUT = 30.0  # s to find a scheduler


class DaskExecutor:
    """Runs trials on the workers of a Dask cluster.

    The scheduler is the one of the option ``scheduler``, or of Dask's own setting (environment
    variable ``DASK_SCHEDULER_ADDRESS``); without either, one is started on this machine with
    ``workers`` workers. Workers need the same installation, and the campaign's directory at the
    same path if worlds and traces are to be kept.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`DaskExecutor`."""

        scheduler: str = ""  #: address such as ``tcp://10.0.0.7:8786``
        workers: int = quantity(low=1, high=512, default=1)  #: of a cluster that is started here
        recycle: int = quantity(low=1, default=200)  #: jobs per child process

    def __init__(self, options: Options) -> None:
        self._options = options
        self._settings: dict[str, Any] = {}
        self._digest = ""
        self._cluster: Any = None  # Dask's classes have no usable types
        self._client: Any = None
        self._running: dict[str, int] = {}  # numbers of jobs by key of their future
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def open(self, settings: CampaignSettings) -> None:
        """Find or start the scheduler.

        Raises:
            ConfigError: there is no scheduler at the address.
        """
        self._settings = codec.encode(settings)
        self._digest = codec.digest(settings)
        address = self._options.scheduler or dask.config.get("scheduler-address", None)
        if not address:
            start: Any = distributed.LocalCluster
            with safe_path():
                resource_tracker.ensure_running()  # its start would let signals in again
            # Ctrl-C is this process's business
            with signals_held(signal.SIGINT), safe_path():
                self._cluster = start(
                    n_workers=self._options.workers,
                    threads_per_worker=1,
                    processes=True,
                    host=LOOPBACK,
                    dashboard_address=f"{LOOPBACK}:0",
                )
            address = self._cluster.scheduler_address
        why = ""
        try:
            connect: Any = distributed.Client
            self._client = connect(address, timeout=SCHEDULER_TIMEOUT, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            why = str(error)
        if self._client is None:
            # Garbage by now: a client that did not connect. It takes a lock when it is collected,
            # for which it would wait without end while another client or cluster starts.
            gc.collect()
            raise ConfigError(
                f"executor dask: no scheduler answers at {address!r} ({why}); start one by "
                "`dask scheduler`, or leave the address out to start one here"
            )

    def submit(self, job: Job) -> None:
        """Take a job."""
        if self._client is None:
            raise HarnessError("the executor is not open")
        future = self._client.submit(
            run_on_worker, self._digest, self._settings, self._options.recycle, job, pure=False
        )
        self._running[future.key] = job["number"]
        future.add_done_callback(self._done.put)

    def collect(self, timeout: float) -> tuple[Finished, ...]:
        """Wait up to ``timeout`` [s] for jobs to end.

        Raises:
            InputError: a worker cannot open the scenario.
            HarnessError: the scheduler is gone, or a worker cannot run any job.
        """
        done: list[Finished] = []
        try:
            while True:
                done.append(self._finished(self._done.get(timeout=0.0 if done else timeout)))
        except queue.Empty:
            return tuple(done)

    def _finished(self, future: Any) -> Finished:
        number = self._running.pop(future.key)
        if future.status == "finished":
            answer = cast("dict[str, Any]", future.result())
            if "refused" in answer:
                raise InputError(answer["refused"])
            if "broken" in answer:
                raise HarnessError(answer["broken"])
            return Finished(number=number, **answer)
        if future.status == "error":  # the machine is gone, not the trial: Dask tried elsewhere
            return Finished(number=number, fate="crashed", error=f"dask: {future.exception()!r}")
        raise HarnessError(
            f"executor dask: trial {number} is {future.status}: the scheduler is gone"
        )

    def close(self) -> None:
        """End child processes on the workers; a cluster that was started here ends, too."""
        if self._client is not None:
            if self._client.status == "running":
                self._client.run(forget, self._digest)
            self._client.close()
        if self._cluster is not None:
            self._cluster.close()
        self._running.clear()


# --- on a worker ---------------------------------------------------------------------------

_children: dict[tuple[str, int], ProcessExecutor] = {}  # by campaign and thread
_lock = threading.Lock()


def run_on_worker(digest: str, settings: dict[str, Any], recycle: int, job: Job) -> dict[str, Any]:
    """Run one job in the child process of this thread.

    Args:
        digest: of the settings.
        settings: encoded settings of the campaign.
        recycle: jobs per child process.
        job: to run.

    Returns:
        Fields of a :class:`Finished` but its number; or ``refused`` or ``broken`` with a message.
    """
    forget_safe_path()  # of this worker's start: its child looks for modules as any other does
    key = (digest, threading.get_ident())
    try:
        with _lock:
            child = _children.get(key)
            if child is None:
                child = ProcessExecutor(ProcessExecutor.Options(workers=1, recycle=recycle))
                child.open(codec.decode(CampaignSettings, settings, where="dask worker"))
                _children[key] = child
        child.submit(job)
        while True:
            for finished in child.collect(CHILD_TIMEOUT):
                return {
                    "fate": finished.fate,
                    "record": finished.record,
                    "error": finished.error,
                }
    except InputError as error:
        forget_child(key)
        return {"refused": str(error)}
    except PlaceError as error:
        forget_child(key)
        return {"fate": "unwritable", "error": str(error)}
    except HarnessError as error:
        forget_child(key)
        return {"broken": str(error)}


def forget_child(key: tuple[str, int]) -> None:
    """End one child process."""
    with _lock:
        child = _children.pop(key, None)
    if child is not None:
        child.close()


def forget(digest: str) -> None:
    """End all child processes of a campaign on this worker."""
    for key in [key for key in _children if key[0] == digest]:
        forget_child(key)
