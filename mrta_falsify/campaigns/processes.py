"""Processes of this machine for work that is no campaign: searches, re-runs of one failure."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import connection


def spawned(workers: int, *, hear_interrupts: bool = False) -> ProcessPoolExecutor:
    """A pool of fresh processes that end with this one, however it ends.

    Args:
        workers: at most; they begin when there is work.
        hear_interrupts: Ctrl-C reaches them, too; else what runs when it comes is finished.
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
