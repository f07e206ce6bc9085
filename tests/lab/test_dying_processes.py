"""Processes of the lab that are killed: what they ran is run again."""

from __future__ import annotations

import contextlib
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool

import pytest

from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.lab import Lab

GROUPS = [{name: name} for name in "abc"]


@pytest.fixture
def ran(monkeypatch):
    """Run three groups in a pool, each of whose processes ends ``.`` well or ``x`` killed."""

    def run(ends):
        left = iter(ends)

        class Pool:
            def submit(self, function, group):
                future = Future()
                if next(left) == "x":
                    future.set_exception(BrokenProcessPool())
                else:
                    future.set_result([RunResult(status="judged", detail=name) for name in group])
                return future

        monkeypatch.setattr(
            "mrta_falsify.lab.laboratory.spawned",
            lambda workers: contextlib.nullcontext(Pool()),
        )
        with Lab(workers=2) as lab:
            return [(key, result.detail) for key, result in lab._ran(GROUPS)]

    return run


@pytest.mark.parametrize("ends", ["...", "x.....", ".x...", "xxxxxx...", "xxxxxx.xxxx.."])
def test_what_a_killed_process_ran_is_run_again(ran, ends):
    assert ran(ends) == [("a", "a"), ("b", "b"), ("c", "c")]


def test_processes_that_die_three_times_in_a_row_end_it(ran):
    with pytest.raises(HarnessError, match="3 times in a row"):
        ran("x" * 9)
