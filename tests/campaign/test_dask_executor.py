"""The Dask executor, in a process of its own.

Dask's event loop runs in a thread of the process; after hundreds of other tests in the same
process it did not start within Dask's ten seconds.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CASES = Path(__file__).with_name("dask_on_loopback.py")


def test_a_dask_scheduler_with_two_workers_keeps_what_executors_promise():
    pytest.importorskip("distributed")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        str(CASES),
    ]
    done = subprocess.run(
        command, cwd=CASES.parents[2], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout
