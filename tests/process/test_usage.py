"""What processes work and sleep is counted; what they wait for a processor is not."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from mrta_falsify.process import usage
from mrta_falsify.process.usage import (
    LONGEST,
    ProcessClock,
    WallClock,
    cpu_of_tree,
    read_process,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are looked at on Linux")

COUNTED = 1.5 / os.sysconf("SC_CLK_TCK")  # s to which CPU time is known
BURN = "i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done"  # some tenths of a second in sh


@contextlib.contextmanager
def running(script: str) -> Iterator[subprocess.Popen]:
    """A shell that waits for a line on its stdin wherever the script reads one."""
    process = subprocess.Popen(
        ["sh", "-c", script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def begun(process: subprocess.Popen) -> ProcessClock:
    """A clock of a process that has said so and now sleeps, after its first look."""
    assert process.stdout.readline() == "begun\n"
    while read_process(process.pid).state != "S":
        time.sleep(0.001)
    clock = ProcessClock(process.pid)
    assert clock.look() == 0.0
    return clock


def check_counts_work_alone(process: subprocess.Popen, seconds: float) -> None:
    """A clock counts the CPU time of a process that never sleeps, and no more."""
    assert process.stdout.readline() == "begun\n"
    clock, before = ProcessClock(process.pid), cpu_of_tree(process.pid)
    clock.look()
    after, spent = cpu_of_tree(process.pid), 0.0
    while spent < seconds:
        time.sleep(0.01)
        least = cpu_of_tree(process.pid) - after
        spent = clock.look(waited=1.0)
        most = cpu_of_tree(process.pid) - before
        assert least - COUNTED <= spent <= most + COUNTED


def told(process: subprocess.Popen, line: str = "on") -> None:
    process.stdin.write(line + "\n")
    process.stdin.flush()


def test_sleep_counts_but_not_that_of_a_gap_in_which_nobody_looked():
    with running("echo begun; read on") as process:
        clock = begun(process)
        assert clock.look(waited=0.5) == 0.5
        assert clock.look(waited=1000.0) == 0.5 + LONGEST
        clock.restart()
        assert clock.look(waited=0.5) == 0.0


def test_work_counts_and_waiting_for_a_processor_does_not():
    with running(f"echo begun; while :; do {BURN}; done") as process:
        check_counts_work_alone(process, 0.2)


def test_a_child_that_works_while_its_parent_waits_counts():
    with running(f"echo begun; read on; (while :; do {BURN}; done) & wait") as process:
        clock = begun(process)
        told(process)
        while clock.look(waited=0.0) < 0.1:
            time.sleep(0.02)


def test_a_child_that_came_and_went_between_two_looks_counts_once():
    with running(f"echo begun; read on; ({BURN}); echo ended; read on") as process:
        clock = begun(process)
        told(process)
        assert process.stdout.readline() == "ended\n"
        spent = clock.look(waited=0.0)
        assert spent == pytest.approx(cpu_of_tree(process.pid), abs=2.0 * COUNTED)
        assert spent > 2.0 * COUNTED
        assert clock.look(waited=0.0) == pytest.approx(spent, abs=COUNTED)


def test_work_of_a_child_that_was_seen_and_has_ended_is_counted_no_second_time():
    script = f"({BURN}; echo begun; read on; {BURN}) <&3 & wait; echo ended; read on"
    with running(f"exec 3<&0; {script}") as process:
        assert process.stdout.readline() == "begun\n"
        clock = ProcessClock(process.pid)
        clock.look()
        began = cpu_of_tree(process.pid)
        told(process)
        assert process.stdout.readline() == "ended\n"
        spent = clock.look(waited=0.0)
        assert spent == pytest.approx(cpu_of_tree(process.pid) - began, abs=3.0 * COUNTED)


def test_what_ends_without_being_waited_for_takes_nothing_back(monkeypatch):
    """Figures of a tree in which a child is gone, and its parent knows nothing of its work."""

    def seen(number: int) -> usage.Process | None:
        cpu = figures.get(number)
        return cpu and usage.Process(number, 0, "R", 1, *cpu, 0.0)

    monkeypatch.setattr(usage, "descendants", lambda root: [2, 3])
    monkeypatch.setattr(usage, "read_process", seen)
    clock = ProcessClock(1)
    figures = {1: (1.0, 0.0), 2: (2.0, 0.0)}
    assert clock.look() == 0.0
    figures = {1: (1.5, 0.0)}  # 2 is gone
    assert clock.look() == 0.5
    figures = {1: (1.5, 0.0), 2: (2.25, 0.0)}  # it was only missed
    assert clock.look() == 0.75
    figures = {1: (1.5, 2.5), 3: (0.5, 0.0)}  # it has ended by now, and another one has begun
    assert clock.look() == 1.5


def test_a_stopped_process_counts_only_if_it_is_to_answer():
    with running("echo begun; read on") as process:
        clock, answer = begun(process), ProcessClock(process.pid, counts_stops=True)
        os.kill(process.pid, signal.SIGSTOP)
        while read_process(process.pid).state != "T":
            time.sleep(0.001)
        answer.look()
        assert answer.look(waited=0.5) == 0.5
        assert clock.look(waited=0.5) == 0.0


def test_a_thread_that_works_is_no_sleep():
    program = (
        "import sys, threading\n"
        "def burn():\n    while True: pass\n"
        "threading.Thread(target=burn, daemon=True).start()\n"
        "print('begun', flush=True); sys.stdin.readline()\n"
    )
    with running(f'exec {sys.executable} -S -c "{program}"') as process:
        check_counts_work_alone(process, 0.1)


@pytest.mark.parametrize("is_blind", [True, False])
def test_where_nobody_can_be_looked_at_wall_clock_time_counts(monkeypatch, is_blind):
    monkeypatch.setattr(usage, "CAN_LOOK", not is_blind)
    ended = subprocess.Popen(["true"])
    ended.wait()
    for clock in (ProcessClock(os.getpid() if is_blind else ended.pid), WallClock()):
        clock.look(waited=0.5)
        assert clock.look(waited=3.0) == 3.5
