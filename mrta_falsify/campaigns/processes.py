"""A pool of local processes for searches and for re-runs of one failure."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import connection


def spawned(workers: int, *, hear_interrupts: bool = False) -> ProcessPoolExecutor:
    """Start a pool of fresh processes that end with this one, however it ends.

    Args:
        workers: at most; each starts when there is work for it.
        hear_interrupts: Ctrl-C reaches the processes too. Otherwise what runs then is finished.
    """
    return ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
        initargs=(hear_interrupts,),
    )


def _begin(hear_interrupts: bool) -> None:
    if not hear_interrupts:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def wait() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
