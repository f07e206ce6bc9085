"""Copies of this process: their answers, their failures, and what Ctrl-C does to them."""

from __future__ import annotations

import os
import signal
import time

import pytest

from mrta_falsify.core.errors import HarnessError
from mrta_falsify.process.ending import name_of_ending
from mrta_falsify.process.supervisor import run_supervised


@pytest.fixture
def interruptible():
    """Ctrl-C raises KeyboardInterrupt here, whatever the test runner has made of it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_copy_answers_and_leaves_this_process_as_it_was():
    seen = []

    def run():
        seen.append(1)
        return {"pid": os.getpid(), "seen": len(seen)}

    answer = run_supervised(run)
    assert answer["pid"] != os.getpid()
    assert answer["seen"] == 1
    assert seen == []


def test_a_copy_that_fails_is_an_error_and_no_answer():
    def run():
        raise ValueError("on demand")

    with pytest.raises(HarnessError, match="on demand"):
        run_supervised(run)


def test_a_copy_that_is_killed_is_an_error_and_no_answer():
    with pytest.raises(HarnessError, match="ended by SIGKILL, outside the stack"):
        run_supervised(lambda: os.kill(os.getpid(), signal.SIGKILL))


def test_a_copy_does_not_hear_ctrl_c():
    def run():
        os.kill(os.getpid(), signal.SIGINT)
        return {"goes": "on"}

    assert run_supervised(run) == {"goes": "on"}


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_ends_the_copy_and_leaves_no_zombie(tmp_path):
    number = tmp_path / "number"

    def run():
        number.write_text(str(os.getpid()))
        os.kill(os.getppid(), signal.SIGINT)
        time.sleep(60.0)
        return {"a": "false answer"}

    with pytest.raises(KeyboardInterrupt):
        run_supervised(run)
    with pytest.raises(ProcessLookupError):
        os.kill(int(number.read_text()), 0)


def test_a_copy_ends_with_the_process_that_made_it(tmp_path):
    number = tmp_path / "number"

    def sleep():
        number.write_text(str(os.getpid()))
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60.0)

    with pytest.raises(HarnessError, match="ended by SIGKILL, outside the stack"):
        run_supervised(lambda: run_supervised(sleep))
    copy, deadline = int(number.read_text()), time.monotonic() + 30.0
    while _is_alive(copy) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not _is_alive(copy)


def _is_alive(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_an_ending_is_told_by_its_code_or_its_signal():
    assert name_of_ending(3) == "exit code 3"
    assert name_of_ending(-9) == "SIGKILL"
    assert name_of_ending(-40) == "signal 40"  # real-time signals have no name
