"""The check of determinism compares trace digests, whatever else the self-test prints."""

from __future__ import annotations

import sys

import pytest

from mrta_falsify.commands import doctor
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.process.ending import Ending

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux only")

LAST_WORDS = "; print('last words', file=sys.stderr)"
BY_SEED = "import os, sys; print('digest:', 'abc' + os.environ['PYTHONHASHSEED'])"


@pytest.mark.parametrize(
    ("text", "state", "detail"),
    [
        (BY_SEED + LAST_WORDS, "failed", "trace digests differ: abc1 and abc2"),
        ("import sys; print('digest: abc')" + LAST_WORDS, "ok", "one trace digest abc"),
        ("print('abc')", "failed", "it printed no trace digest"),
        ("raise SystemExit('no world')", "failed", "the self-test did not run: no world"),
    ],
)
def test_digests_are_compared(monkeypatch, text, state, detail):
    monkeypatch.setattr(doctor, "_SELF_TEST", text)
    check = doctor._check_determinism()
    assert check.state == state
    assert detail in check.detail


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (HarnessError("python: cannot be started"), "python: cannot be started"),
        (Ending("crash", "ended by SIGKILL"), "the self-test ended by SIGKILL"),
    ],
)
def test_a_self_test_that_does_not_run_is_a_failed_check(monkeypatch, error, why):
    def fail(*args):
        raise error

    monkeypatch.setattr(doctor, "run_command", fail)
    assert doctor._check_determinism() == doctor._failed_self_test(why)
