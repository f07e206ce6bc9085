"""Trials on a Dask cluster, for campaigns that outgrow one machine (extra ``dask``).

Dask carries jobs to its workers and results back. On a worker, a job runs in a child process
of :class:`~mrta_falsify.campaigns.executors.ProcessExecutor`, as on one machine. It is compiled
once and killed when its time is up, and a crash costs one trial and not the worker. A worker on a
machine that does not see the campaign's directory sends the files of a trial back with its record.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import os
import queue
import shutil
import signal
import socket
import threading
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import dask
import distributed

from mrta_falsify.campaigns.executors import Finished, Job, ProcessExecutor
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.store import SETTINGS, TRIALS, removed
from mrta_falsify.core import codec
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.durable import make_folder, write_atomically
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
    ``workers`` workers. Workers need the same installation, and the scenario at the same path. They
    need neither the campaign's directory nor a home in common.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Options of :class:`DaskExecutor`."""

        scheduler: str = ""  #: address such as ``tcp://10.0.0.7:8786``
        workers: int = quantity(low=1, high=512, default=1)  #: of a cluster that is started here
        recycle: int = quantity(low=1, default=200)  #: jobs per child process

    def __init__(self, options: Options) -> None:
        self._options = options
        self._encoded: dict[str, Any] = {}  # settings of the campaign
        self._digest = ""
        self._directory = Path()
        self._cluster: Any = None  # Dask's classes have no usable types
        self._client: Any = None
        self._done: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()

    def open(self, settings: CampaignSettings) -> None:
        """Find or start the scheduler.

        Raises:
            ConfigError: there is no scheduler at the address.
        """
        self._encoded, self._digest = codec.encode(settings), codec.digest(settings)
        self._directory = Path(settings.trials.directory)
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
            run_on_worker, self._digest, self._encoded, self._options.recycle, job, pure=False
        )
        future.add_done_callback(lambda future: self._done.put((job["number"], future)))

    def collect(self, timeout: float) -> tuple[Finished, ...]:
        """Wait up to ``timeout`` [s] for jobs to end.

        Raises:
            InputError: a worker cannot open the scenario.
            HarnessError: the scheduler is gone, or a worker cannot run any job.
        """
        done: list[Finished] = []
        with contextlib.suppress(queue.Empty):
            while True:
                done.append(self._finished(*self._done.get(timeout=0.0 if done else timeout)))
        return tuple(done)

    def _finished(self, number: int, future: Any) -> Finished:
        if future.status == "error":  # the machine is gone, not the trial: Dask tried elsewhere
            return Finished(number=number, fate="crashed", error=f"dask: {future.exception()!r}")
        if future.status != "finished":
            raise HarnessError(
                f"executor dask: trial {number} is {future.status}: the scheduler is gone"
            )
        answer: Answer = future.result()
        if isinstance(answer, Exception):
            raise answer
        finished, files = answer
        try:
            self._keep(files)
        except PlaceError as error:
            return Finished(number=number, fate="unwritable", error=str(error))
        return finished

    def _keep(self, files: dict[str, bytes]) -> None:
        """Write the files of a trial that a worker has sent; they are durable on return."""
        for name, data in files.items():
            if not (self._directory / SETTINGS).is_file():
                raise removed(self._directory)
            make_folder((self._directory / name).parent)
            write_atomically(self._directory / name, data)

    def close(self) -> None:
        """End child processes on the workers; a cluster that was started here ends, too."""
        if self._client is not None:
            if self._client.status == "running":
                self._client.run(forget, self._digest)
            self._client.close()
        if self._cluster is not None:
            self._cluster.close()


# --- on a worker ---------------------------------------------------------------------------

#: what became of a job, and the files of its trial that are not in the campaign's directory yet, by
#: their name there; an error: no job can be run
Answer = tuple[Finished, dict[str, bytes]] | Exception

#: by campaign and thread: a child process, and where it writes if not in the campaign's directory
_children: dict[tuple[str, int], tuple[ProcessExecutor, Path | None]] = {}
_lock = threading.Lock()


def run_on_worker(digest: str, settings: dict[str, Any], recycle: int, job: Job) -> Answer:
    """Run one job in the child process of this thread.

    Args:
        digest: of the settings.
        settings: encoded settings of the campaign.
        recycle: jobs per child process.
        job: to run.
    """
    forget_safe_path()  # of this worker's start: its child looks for modules as any other does
    try:
        child, folder = _child(digest, settings, recycle)
        child.submit(job)
        while not (done := child.collect(CHILD_TIMEOUT)):
            pass
        return done[0], _taken(folder) if folder is not None else {}
    except PlaceError as error:
        forget(digest)
        return Finished(number=job["number"], fate="unwritable", error=str(error)), {}
    except (InputError, HarnessError) as error:
        forget(digest)
        kind = InputError if isinstance(error, InputError) else HarnessError
        where = f"Dask worker on {socket.gethostname()}, in {os.getcwd()}"
        return kind(f"{where}: {error}")  # returned: Dask prints a traceback of what is raised


def _child(
    digest: str, encoded: dict[str, Any], recycle: int
) -> tuple[ProcessExecutor, Path | None]:
    """Give the child process of this thread; it is started by the first job."""
    key = (digest, threading.get_ident())
    with _lock:
        if key in _children:
            return _children[key]
        settings = codec.decode(CampaignSettings, encoded, where="dask worker")
        trials, folder = settings.trials, None
        if trials.directory and not os.path.isdir(trials.directory):
            # Dask removes this folder with the worker, or when the next one starts after a crash
            own = Path(distributed.get_worker().local_directory)
            folder = make_folder(own / f"{digest}-{key[1]}")
            trials = dataclasses.replace(trials, directory=str(folder))
        child = ProcessExecutor(ProcessExecutor.Options(workers=1, recycle=recycle))
        child.open(dataclasses.replace(settings, trials=trials))
        _children[key] = child, folder
        return child, folder


def _taken(folder: Path) -> dict[str, bytes]:
    """Read the files of a trial, and remove them."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    files = {str(path.relative_to(folder)): path.read_bytes() for path in paths}
    shutil.rmtree(folder / TRIALS, ignore_errors=True)
    return files


def forget(digest: str) -> None:
    """End all child processes of a campaign on this worker."""
    with _lock:
        ended = [_children.pop(key) for key in list(_children) if key[0] == digest]
    for child, _ in ended:
        child.close()
