"""What becomes of Ctrl-C on its way to the command."""

from __future__ import annotations

import pytest

from mrta_falsify.core.interruption import Interrupted, heard, is_interruption, telling


def _as_compiled_code_has_it(cause: BaseException) -> SystemError:
    error = SystemError("CPUDispatcher(...) returned a result with an exception set")
    error.__cause__ = cause
    return error


def test_what_compiled_code_makes_of_ctrl_c_is_an_interruption():
    assert is_interruption(KeyboardInterrupt())
    assert is_interruption(_as_compiled_code_has_it(KeyboardInterrupt()))
    assert not is_interruption(_as_compiled_code_has_it(ValueError()))
    assert not is_interruption(SystemError())


def test_it_passes_as_what_it_is_and_other_errors_stay():
    with pytest.raises(KeyboardInterrupt), heard():
        raise _as_compiled_code_has_it(KeyboardInterrupt())
    with pytest.raises(SystemError), heard():
        raise _as_compiled_code_has_it(ValueError())


@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), _as_compiled_code_has_it(KeyboardInterrupt())]
)
def test_it_says_what_is_kept_and_the_innermost_knows_best(error):
    outer, inner = (lambda: ("nothing", "all")), (lambda: ("2 runs", "1 run"))
    with pytest.raises(Interrupted, match="1 run; kept: 2 runs"), telling(outer), telling(inner):
        raise error
