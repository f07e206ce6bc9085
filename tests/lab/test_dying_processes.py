"""Processes of the lab that are killed: what they ran is run again."""

from __future__ import annotations

import fcntl
import functools
import os
import signal
import sys

import pytest

from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.run_result import RunResult
from mrta_falsify.lab import Lab
from mrta_falsify.process.pool import Pool

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="kills workers of Linux")

GROUPS = [{name: name} for name in "abc"]


def opened(ends):
    return functools.partial(run_one, ends)


def run_one(ends, group):
    """End as the first letter of a file says, which is then gone."""
    with open(ends, "r+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        how, rest = (text := file.read())[:1], text[1:]
        file.seek(0)
        file.truncate()
        file.write(rest)
    if how == "x":
        os.kill(os.getpid(), signal.SIGKILL)
    return [RunResult(status="judged", detail=name) for name in group]


@pytest.fixture
def ran(monkeypatch, tmp_path):
    """Run three groups in a pool, each of whose processes ends ``.`` well or ``x`` killed."""

    def run(ends):
        (tmp_path / "ends").write_text(ends)
        begin = functools.partial(opened, tmp_path / "ends")
        monkeypatch.setattr(
            "mrta_falsify.lab.laboratory.Pool", lambda usual, workers: Pool(begin, workers=workers)
        )
        with Lab(workers=2) as lab:
            return [(key, result.detail) for key, result in lab._ran(GROUPS)]

    return run


@pytest.mark.parametrize("ends", ["...", "x...", ".x..", "xxxx..."])
def test_what_a_killed_process_ran_is_run_again(ran, ends):
    assert ran(ends) == [("a", "a"), ("b", "b"), ("c", "c")]


def test_processes_that_die_three_times_in_a_row_end_it(ran):
    with pytest.raises(HarnessError, match="3 times in a row"):
        ran("x" * 9)
