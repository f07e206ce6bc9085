"""Children: what a job returns, and what is left of them, which is nothing."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from mrta_falsify.core.errors import ConfigError, HarnessError
from mrta_falsify.process.budget import Budget, credit
from mrta_falsify.process.child import fork
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.pool import Pool
from mrta_falsify.process.program import Command, Program, _Keeper
from mrta_falsify.process.supervisor import run_command, run_supervised
from mrta_falsify.process.usage import members_of_session
from mrta_falsify.process.watch import current_watch

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux")

SOON = 30.0  # s


def ends(number: int) -> bool:
    """Whether a process ends soon."""
    until = time.monotonic() + SOON
    while time.monotonic() < until:
        with contextlib.suppress(psutil.NoSuchProcess):
            if psutil.Process(number).status() != psutil.STATUS_ZOMBIE:
                time.sleep(0.01)
                continue
        return True
    return False


def python(text: str) -> Command:
    return Command([sys.executable, "-S", "-c", text], os.environ)


# --- jobs and commands ----------------------------------------------------------------------


def test_a_job_returns_its_value_from_a_copy():
    assert run_supervised(os.getpid) not in (None, os.getpid())


def refuse():
    raise ConfigError("stack.planner is 7")


def test_what_a_job_raises_is_raised_here():
    with pytest.raises(ConfigError, match="planner is 7"):
        run_supervised(refuse)


def test_a_command_gives_its_exit_code_and_what_it_printed():
    done = run_command(python("print('out'); raise SystemExit(3)"), Budget())
    assert (done.code, done.text) == (3, "out\n")


def test_a_command_that_does_not_end_is_ended():
    with pytest.raises(Ending) as ended:
        run_command(python("import time; time.sleep(60)"), Budget(work=0.2))
    assert (ended.value.kind, str(ended.value)) == ("hang", "the stack did not end within 0.2 s")


def test_a_command_that_is_none_is_an_error():
    with pytest.raises(HarnessError, match="no-such-program: cannot be started: No such file"):
        run_command(Command(["no-such-program"], {}), Budget())


# --- what is left ----------------------------------------------------------------------------


def leave_children(file: Path) -> None:
    """Start one process as usual and one in a session of its own; note their numbers."""
    words = [sys.executable, "-S", "-c", "import time; time.sleep(600)"]
    children = [subprocess.Popen(words), subprocess.Popen(words, start_new_session=True)]
    file.write_text(" ".join(str(child.pid) for child in children))


def left_by(file: Path) -> list[int]:
    return [number for number in map(int, file.read_text().split()) if not ends(number)]


def test_a_stack_that_ends_its_process_leaves_no_children(tmp_path):
    def crash():
        current_watch().enter(3, 0.15)
        leave_children(tmp_path / "numbers")
        time.sleep(0.3)  # somebody looks at them
        os._exit(7)

    with pytest.raises(Ending, match="ended its process by exit code 7"):
        run_supervised(crash)
    assert left_by(tmp_path / "numbers") == []


def test_a_fork_that_has_answered_leaves_no_children(tmp_path):
    run_supervised(lambda: leave_children(tmp_path / "numbers"))
    assert left_by(tmp_path / "numbers") == []


def opened():
    return leave_and_die


def leave_and_die(file):
    leave_children(file)
    time.sleep(0.6)
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_worker_that_is_killed_leaves_no_children(tmp_path):
    with Pool(opened) as pool:
        pool.submit("a", tmp_path / "numbers")
        done = []
        while not done:
            done = pool.collect(0.05)
    assert done[0].key == "a"
    assert done[0].outcome.text == "ended by signal 9"
    assert left_by(tmp_path / "numbers") == []


def test_what_is_left_is_killed_when_an_end_is_noticed_and_never_later(monkeypatch):
    """Later the number may be that of a session of somebody else."""
    copy = fork()
    if copy is None:
        subprocess.Popen(["sleep", "600"])
        os._exit(0)
    (left,) = wait_for_session(copy.number)
    assert copy.code(wait=True) == 0
    assert ends(left)
    other = subprocess.Popen(["sleep", "600"], start_new_session=True)
    try:
        monkeypatch.setattr(copy, "number", other.pid)
        copy.kill()
        assert other.poll() is None
    finally:
        other.kill()
        other.wait()


def wait_for_session(session):
    until = time.monotonic() + SOON
    while not (found := [n for n in members_of_session(session) if n != session]):
        assert time.monotonic() < until
        time.sleep(0.01)
    return found


def test_a_program_ends_with_its_owner_and_so_does_what_it_has_started(tmp_path):
    """The owner is killed while another process holds its connection to the keeper."""
    numbers = tmp_path / "numbers"
    text = f"""
import os, subprocess, time
child = subprocess.Popen(["sleep", "600"], start_new_session=True)
open({str(numbers)!r}, "w").write(f"{{os.getpid()}} {{child.pid}}\\n")
time.sleep(600)
"""
    owner = fork()
    if owner is None:
        program = Program(python(text))
        program.error()
        holder = os.fork()
        signal.pause()
        os._exit(holder)
    until = time.monotonic() + SOON
    while not (numbers.exists() and numbers.read_text().endswith("\n")):
        assert time.monotonic() < until
        time.sleep(0.01)
    family = psutil.Process(owner.number).children()
    os.kill(owner.number, signal.SIGKILL)
    try:
        assert left_by(numbers) == []
    finally:
        owner.kill()
        for process in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()


def pause():
    current_watch().enter(0, 0.0)
    signal.pause()


def copies_of_here():
    return [
        child for child in psutil.Process().children() if child.status() != psutil.STATUS_ZOMBIE
    ]


@pytest.mark.parametrize(
    "begin",
    [lambda: run_supervised(pause), lambda: Program(python("import time; time.sleep(600)"))],
)
def test_ctrl_c_during_a_fork_leaves_no_copy(monkeypatch, begin):
    """The signal comes before the copy is known to anybody."""
    copy = os.fork

    def interrupted():
        number = copy()
        if number:
            os.kill(os.getpid(), signal.SIGINT)
        return number

    before = copies_of_here()
    monkeypatch.setattr(os, "fork", interrupted)
    with pytest.raises(KeyboardInterrupt):
        begin()
    assert copies_of_here() == before


def interrupting():
    return interrupt


def interrupt(job):
    if job == "interrupt":
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(SOON)
    return job


def test_an_interrupt_in_a_worker_costs_its_job_only():
    with Pool(interrupting) as pool:
        found = {}
        for key in ("interrupt", "go on"):
            pool.submit(key, key)
        while len(found) < 2:
            found |= {done.key: done.outcome for done in pool.collect(0.05)}
    assert found["interrupt"].text == "ended by signal 2"
    assert found["go on"].value == "go on"


def test_a_keeper_that_answers_late_has_not_ended(monkeypatch):
    monkeypatch.setattr("mrta_falsify.process.program.PATIENCE", 0.01)
    answer = _Keeper._answer

    def late(keeper, question, output):
        time.sleep(0.1)
        answer(keeper, question, output)

    monkeypatch.setattr(_Keeper, "_answer", late)
    program = Program(python("import time; time.sleep(600)"))
    try:
        assert not program.has_ended()
        assert program.state().code is None
    finally:
        program.close()


def test_a_late_answer_is_not_taken_for_the_next_one():
    program = Program(python("import time; time.sleep(600)"))
    try:
        program._ours.sendall(b"begun 0\n")  # nobody waits for its answer
        assert program.state().code is None
        program.ask_to_end()
        assert ends(program.kept()[0])
        assert program.state().code == -signal.SIGTERM
    finally:
        program.close()


def test_a_keeper_whose_owner_is_gone_before_its_answer_ends_all_in_silence(monkeypatch, capfd):
    answer = _Keeper._answer

    def late(keeper, question, output):
        time.sleep(0.3)
        answer(keeper, question, output)

    monkeypatch.setattr(_Keeper, "_answer", late)
    program = Program(python("import time; time.sleep(600)"))
    until = time.monotonic() + SOON
    while not (kept := program.kept()):
        assert time.monotonic() < until
        time.sleep(0.01)
    program._ours.sendall(b"begun 0\n")
    program.close()
    assert ends(kept[0])
    assert capfd.readouterr().err == ""


def test_a_keeper_that_is_told_to_end_while_it_ends_kills_all(monkeypatch):
    end_all = _Keeper.end_all

    def told_again(keeper):
        os.kill(os.getpid(), signal.SIGTERM)
        end_all(keeper)

    monkeypatch.setattr(_Keeper, "end_all", told_again)
    program = Program(python("import time; time.sleep(600)"))
    assert program.error() == ""
    (kept,) = program.kept()
    program._ours.shutdown(socket.SHUT_RDWR)
    assert program._keeper.code(wait=True) == 0
    assert not psutil.pid_exists(kept)
    program.close()


# --- the budget of a pool ----------------------------------------------------------------------


def sleeper():
    return sleep


def sleep(seconds):
    for each in seconds:
        time.sleep(each)
        credit()
    return len(seconds)


def fates(jobs):
    with Pool(sleeper, workers=2, budget=Budget(work=0.6), recycle=1) as pool:
        for key, job in jobs.items():
            pool.submit(key, job)
        found = {}
        while len(found) < len(jobs):
            found |= {done.key: done.outcome for done in pool.collect(0.05)}
    return found


def test_credit_begins_a_budget_again():
    found = fates({"credited": [0.4, 0.4, 0.4], "late": [30.0]})
    assert found["credited"].value == 3
    assert found["late"].text == "killed after 0.6 s of work and sleep"


def test_a_pool_starts_no_more_workers_than_there_are_jobs():
    with Pool(sleeper, workers=3) as pool:
        assert len(pool.workers) == 0
        pool.submit("a", [])
        assert len(pool.workers) == 1
        pool.submit("b", [])
        assert len(pool.workers) == 2


def test_every_result_comes_with_the_number_of_its_job():
    with Pool(sleeper, workers=2) as pool:
        jobs = [[0.3], [], [0.01, 0.01]]
        assert sorted(pool.unordered(jobs)) == [(0, 1), (1, 0), (2, 2)]


def evaluating():
    return eval


def test_a_result_that_cannot_be_sent_is_an_error_of_the_harness():
    with Pool(evaluating) as pool, pytest.raises(HarnessError, match="lambda"):
        list(pool.unordered(["lambda: 0"]))
