"""What becomes of Ctrl-C on its way to the command."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

from mrta_falsify.core.interruption import (
    STOP_SIGNALS,
    Interrupted,
    describe_interrupt,
    is_interruption,
    propagate_interrupts,
    signals_held,
)


def _as_compiled_code_has_it(cause: BaseException) -> SystemError:
    error = SystemError("CPUDispatcher(...) returned a result with an exception set")
    error.__cause__ = cause
    return error


def test_what_compiled_code_makes_of_ctrl_c_is_an_interruption():
    assert is_interruption(KeyboardInterrupt())
    assert is_interruption(_as_compiled_code_has_it(KeyboardInterrupt()))
    assert not is_interruption(_as_compiled_code_has_it(ValueError()))
    assert not is_interruption(SystemError())


def test_ctrl_c_while_a_class_is_made_is_an_interruption():
    class Interrupting:
        def __set_name__(self, owner, name):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), propagate_interrupts():
        type("Made", (), {"part": Interrupting()})


def test_what_an_interruption_says_is_kept_where_another_error_hides_it():
    error = RuntimeError()
    error.__cause__ = Interrupted(kept="2 runs", missing="1 run")
    with pytest.raises(Interrupted, match="1 run; kept: 2 runs"), propagate_interrupts():
        raise error


def test_it_passes_as_what_it_is_and_other_errors_stay():
    with pytest.raises(KeyboardInterrupt), propagate_interrupts():
        raise _as_compiled_code_has_it(KeyboardInterrupt())
    with pytest.raises(SystemError), propagate_interrupts():
        raise _as_compiled_code_has_it(ValueError())


@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), _as_compiled_code_has_it(KeyboardInterrupt())]
)
def test_it_says_what_is_kept_and_the_innermost_knows_best(error):
    outer, inner = (lambda: ("nothing", "all")), (lambda: ("2 runs", "1 run"))
    with (
        pytest.raises(Interrupted, match="1 run; kept: 2 runs"),
        describe_interrupt(outer),
        describe_interrupt(inner),
    ):
        raise error


@pytest.fixture
def another_thread():
    """A thread of this process that hears signals, as those of compiled libraries do."""
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    yield
    over.set()
    thread.join()


@pytest.mark.usefixtures("another_thread")
def test_held_signals_are_heard_at_the_end_though_another_thread_takes_them():
    handlers = [signal.getsignal(number) for number in STOP_SIGNALS]
    reached = []

    def interrupted():
        with signals_held():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)  # the other thread has heard it
            reached.append("the end")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert reached == ["the end"]
    assert [signal.getsignal(number) for number in STOP_SIGNALS] == handlers
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, []) & set(STOP_SIGNALS)


def test_a_copy_made_while_signals_are_held_keeps_its_own_handlers():
    with signals_held():
        copy = os.fork()
        if copy == 0:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
    if copy == 0:
        os._exit(0 if signal.getsignal(signal.SIGINT) is signal.SIG_IGN else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1]) == 0
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
