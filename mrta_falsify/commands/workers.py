"""Who runs trials: local processes, or an executor by name."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Iterator

from mrta_falsify.campaigns.runner import Executor
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.lab import laboratory


def count_cores(wanted: int | None) -> int:
    """Return ``wanted``, or the number of cores that this process may use if None."""
    return wanted or len(os.sched_getaffinity(0))


def local_workers(wanted: int | None) -> Choice:
    """Choose the executor of ``wanted`` local processes; one per core if None."""
    return laboratory.local_workers(count_cores(wanted))


def chosen_executor(name: str | None, workers: int | None) -> Choice:
    """Choose an executor by name, with ``workers`` if it has any; local processes if None.

    Raises:
        InputError: unknown name, or an extra that is not installed.
    """
    if name is None:
        return local_workers(workers)
    options = registry.load("executor", name, where="campaign").Options
    takes_workers = any(field.name == "workers" for field in dataclasses.fields(options))
    return Choice(name, local_workers(workers).options) if takes_workers else Choice(name)


@contextlib.contextmanager
def open_executor(settings: CampaignSettings, choice: Choice) -> Iterator[Executor]:
    """Open an executor by name for a campaign; close it, with its workers, at the end."""
    executor = registry.build("executor", choice, where="campaign")
    try:
        executor.open(settings)
        yield executor
    finally:
        executor.close()
