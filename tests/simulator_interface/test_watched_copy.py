"""Copies of a process that are watched: what comes back, what is killed, what is an error."""

import mmap
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError, UnknownNameError
from mrta_falsify.core.stack_failure import StackFailed, StackLimits
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import Request, Supervisor
from mrta_falsify.process.watch import current_watch
from simulator_interface.failing_layer import Place, dumped_places, portable_path, shared_places
from simulator_interface.guard import Guard, current_guard, guarded

LIMITS = StackLimits(tick=0.2, memory=0.25)
# 48 MB are taken up between two looks even by a slow machine.
LITTLE_MEMORY = StackLimits(tick=10.0, memory=2**-5)


def burn(seconds: float) -> None:
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def fresh(size: int) -> mmap.mmap:
    """Take up memory that this process has not had: an allocator may keep what was freed."""
    block = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    for begin in range(0, size, mmap.PAGESIZE):
        block[begin] = 1
    return block


def asked(call, limits=LIMITS):
    copy = Supervisor(Budget.of_stack(limits))
    try:
        copy.ask(Request(call))
        return copy.answer()
    finally:
        copy.close()


def test_what_a_call_returns_comes_back_and_the_copy_is_kept_for_more():
    copy = Supervisor(Budget.of_stack(LIMITS))
    copy.ask(Request(os.getpid))
    first = copy.answer()
    assert copy.ask(Request(os.getpid))
    assert copy.answer() == first != os.getpid()
    copy.close()
    copy.close()
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)


class RunInCircles:
    """A run whose objects refer to each other, with 16 MB of arrays."""

    def __init__(self) -> None:
        self.itself = self
        self.columns = bytearray(2**24)


def resident_after_a_run() -> int:
    RunInCircles()
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGESIZE")


def test_a_copy_keeps_nothing_of_the_runs_before():
    copy = Supervisor(Budget.of_stack(LIMITS))
    taken = []
    for _ in range(8):
        copy.ask(Request(resident_after_a_run))
        taken.append(copy.answer())
    copy.close()
    assert max(taken) - taken[0] < 2**24


def test_exceptions_keep_their_class_and_words():
    def unknown():
        raise UnknownNameError("planner", "astra", ["astar"], where="stack")

    def missing():
        os.stat("no such file")

    with pytest.raises(UnknownNameError, match="unknown planner 'astra'; did you mean 'astar'"):
        asked(unknown)
    with pytest.raises(FileNotFoundError) as caught:
        asked(missing)
    assert caught.value.filename == "no such file"
    assert "in missing" in str(caught.value.__cause__)


def test_an_answer_that_cannot_be_sent_is_an_error_of_the_harness():
    with pytest.raises(HarnessError, match="lambda"):
        asked(lambda: lambda: None)


def test_a_process_that_ends_outside_the_stack_is_an_error_of_the_harness():
    with pytest.raises(HarnessError, match="exit code 9, outside the stack"):
        asked(lambda: os._exit(9))


def in_stack(work):
    def call():
        current_watch().enter(7, 0.35)
        work()
        current_watch().leave()
        return "done"

    return call


def test_a_call_of_the_stack_that_takes_too_long_is_killed():
    with pytest.raises(Ending) as caught:
        asked(in_stack(lambda: burn(30.0)))
    failed = caught.value
    assert (failed.kind, failed.tick, failed.time) == ("hang", 7, 0.35)
    assert " in burn\n" in failed.where


BURNS = "while True: pass  # of a watched copy"


def a_child_burns() -> None:
    subprocess.run([sys.executable, "-S", "-c", BURNS], check=True)


def burning() -> list[str]:
    """List the processes that such a call has started."""
    commands = (path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline"))
    return [command.decode() for command in commands if BURNS.encode() in command]


@pytest.mark.parametrize(
    "work",
    [
        lambda: time.sleep(30.0),
        lambda: os.kill(os.getpid(), signal.SIGSTOP),
        a_child_burns,
    ],
    ids=["sleeps", "stops itself", "has a child that burns"],
)
def test_a_call_of_the_stack_that_gives_no_answer_hangs_whatever_it_does(work):
    with pytest.raises(Ending) as caught:
        asked(in_stack(work))
    assert caught.value.kind == "hang"
    assert burning() == []


def test_time_outside_the_stack_and_time_to_compile_do_not_count():
    def compiling():
        heartbeat = current_watch().heartbeat
        heartbeat.compile_begins()
        burn(0.6)
        heartbeat.compile_ends()

    assert asked(lambda: burn(0.6)) is None
    assert asked(in_stack(compiling)) == "done"


def test_memory_taken_outside_the_stack_does_not_count():
    held = []

    def outside():
        held.append(bytearray(2**29))
        current_watch().enter(1, 0.05)
        time.sleep(0.3)
        return current_watch().leave()

    limits = StackLimits(tick=60.0, memory=0.25)
    assert asked(outside, limits) == 0.0
    with pytest.raises(Ending) as caught:
        asked(in_stack(lambda: (held.append(bytearray(2**29)), time.sleep(5.0))), limits)
    assert caught.value.kind == "memory"


def test_a_call_over_both_limits_at_the_first_look_took_too_much_memory():
    reader, writer = os.pipe()

    def hoards():
        held = bytearray(2**29)
        burn(0.5)
        os.write(writer, b"over both")
        burn(30.0)
        return held

    copy = Supervisor(Budget.of_stack(LIMITS))
    copy.ask(Request(in_stack(hoards)))
    os.read(reader, 9)  # as on a machine so busy that nobody looked before
    with pytest.raises(Ending) as caught:
        copy.answer()
    assert caught.value.kind == "memory"


# --- the guard -----------------------------------------------------------------------------


def episode(*ticks: int):
    """A call of the stack that hangs at ``ticks[n]`` in its n-th run; ends early if told to."""
    reader, writer = os.pipe()
    os.write(writer, bytes(ticks))
    os.set_blocking(reader, False)

    def call():
        for tick in range(100):
            try:
                current_watch().enter(tick, tick / 20)
            except StackFailed as failed:
                return failed.failure
            if tick == 20:
                at = os.read(reader, 1)[0]
            if tick >= 20 and tick == at:
                burn(30.0)
            current_watch().leave()
        return "passed"

    return call


def run(call, limits=LIMITS):
    guard = Guard()
    try:
        return guard.run(call, config=StackConfig(), limits=limits, portable=False)
    finally:
        guard.close()


def test_a_hang_in_two_runs_ends_the_third_at_its_tick():
    failure = run(episode(50, 50, 99))
    assert (failure.kind, failure.tick, failure.time) == ("hang", 50, 2.5)
    assert failure.message == "the stack gave no answer within 0.2 s of CPU time"
    assert all(":" not in frame for frame in failure.frames)  # a loop is stuck at no one line


def test_a_hang_at_another_tick_ends_at_the_earlier_one():
    assert run(episode(60, 40, 99)).tick == 40


def test_a_hang_in_one_of_two_runs_is_no_verdict():
    with pytest.raises(HarnessError, match=r"at tick 50 \(2\.50 s\); in a second run it did not"):
        run(episode(50, 0))


@pytest.mark.parametrize("megabytes", [48, 1])
def test_memory_may_be_found_within_a_call_and_after_it(megabytes):
    """The first run is ended from outside, the second one by itself, if it is as large."""
    reader, writer = os.pipe()
    os.write(writer, bytes([1, 0, 0]))

    def call():
        is_first = os.read(reader, 1)[0]
        current_watch().enter(7, 0.35)
        block = fresh((48 if is_first else megabytes) * 2**20)
        if is_first:
            burn(30.0)
        return len(block) > 0 and current_watch().leave() > 0.0

    if megabytes == 48:
        assert run(call, LITTLE_MEMORY)
    else:
        with pytest.raises(HarnessError, match=r"took up more than 0\.03125 GiB .* it did not"):
            run(call, LITTLE_MEMORY)


def test_a_copy_needs_no_guard_of_its_own():
    with guarded():
        assert current_guard() is not None
        assert current_guard().run(
            lambda: current_guard() is None, config=StackConfig(), limits=LIMITS, portable=False
        )
    assert current_guard() is None


# --- tracebacks ----------------------------------------------------------------------------


def test_a_dump_is_read_from_the_door_inwards():
    text = (
        "Current thread 0x00007f (most recent call first):\n"
        '  File "/home/me/mine.py", line 12 in spin\n'
        '  File "/home/me/mine.py", line 30 in control\n'
        '  File "/opt/door.py", line 99 in ask\n'
        '  File "/opt/main.py", line 1 in main\n'
    )
    found = dumped_places(text, "/opt/door.py")
    assert [(place.function, place.line) for place in found] == [("control", 30), ("spin", 12)]
    other = [found[0], Place("/home/me/mine.py", 14, "step")]
    assert [str(place) for place in shared_places(found, other)] == ["mine.py in control"]


def test_paths_of_the_machine_are_left_out(monkeypatch):
    monkeypatch.syspath_prepend("/home/me/code")
    assert portable_path("/home/me/code/mine/planner.py") == os.path.join("mine", "planner.py")
    assert portable_path("/elsewhere/planner.py") == "planner.py"
    assert portable_path(Guard.__init__.__code__.co_filename) == "simulator_interface/guard.py"
