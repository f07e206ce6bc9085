"""A pool of local processes for searches and for re-runs of one failure."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import connection
from typing import Any

from mrta_falsify.core.garbage import collect_seldom
from mrta_falsify.core.interruption import signals_held
from mrta_falsify.core.modules import forget_safe_path, safe_path

MAX_DEATHS = 3  # of processes of a pool, one after the other, without a result


class _Pool(ProcessPoolExecutor):
    """A pool whose processes never hear what stops a command, not even while they start."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        # processes start here, and what is held back stays so in them
        with signals_held(), safe_path():
            return super().submit(fn, *args, **kwargs)


@contextlib.contextmanager
def spawned(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of fresh processes that end with this one, however it ends.

    They do not hear Ctrl-C. An exception inside, Ctrl-C too, kills them and what they run.

    Args:
        workers: at most; each starts when there is work for it.
    """
    others = set(multiprocessing.active_children())
    with safe_path():  # a process that keeps track of semaphores starts here
        pool = _Pool(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)
    try:
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def _begin() -> None:
    forget_safe_path()
    collect_seldom()
    parent = multiprocessing.parent_process()

    def wait() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
