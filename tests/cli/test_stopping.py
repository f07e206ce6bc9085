"""Ctrl-C and SIGTERM in a process of its own: one exception, an undisturbed clean-up, an end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import pytest

from mrta_falsify.cli.options import format_option
from mrta_falsify.core.interruption import Interrupted

LISTEN = "from mrta_falsify.cli import stopping; stopping.listen(); "
READY = "print('ready', flush=True); "


def _stopped(program: str, *signals: signal.Signals) -> subprocess.CompletedProcess[str]:
    """Run a program that says when it is ready, and send it signals, one for each line it says."""
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    heard = ""
    for number in signals:
        heard += process.stdout.readline()
        os.kill(process.pid, number)
    stdout, stderr = process.communicate(timeout=60.0)
    return subprocess.CompletedProcess([], process.returncode, heard + stdout, stderr)


def _interrupted(
    *work: str, before: str = "", after: tuple[str, ...] = ("print('caught')",)
) -> str:
    """Write a program that does its work until it is interrupted."""
    lines = ["try:", *(f"    {line}" for line in work), "    time.sleep(60)"]
    lines += ["except KeyboardInterrupt:", *(f"    {line}" for line in after)]
    return "\n".join(["import signal, time", before, LISTEN, *lines])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_is_a_keyboard_interrupt(number):
    ended = _stopped(_interrupted(READY), number)
    assert (ended.returncode, ended.stdout) == (0, "ready\ncaught\n")


def test_sigterm_is_heard_where_ctrl_c_is_ignored():
    """A script that puts a command in its background has Ctrl-C ignored there."""
    program = _interrupted(
        READY,
        "time.sleep(0.3)",
        "print('still here', flush=True)",
        before="signal.signal(signal.SIGINT, signal.SIG_IGN)",
    )
    ended = _stopped(program, signal.SIGINT, signal.SIGTERM)
    assert (ended.returncode, ended.stdout) == (0, "ready\nstill here\ncaught\n")


def test_an_interruption_that_a_finalizer_swallows_comes_again():
    slow = f"class Slow:\n    def __del__(self):\n        {READY}\n        time.sleep(60)"
    program = _interrupted("Slow()", before=slow)
    ended = _stopped(program, signal.SIGINT)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "ready\ncaught\n", "")


def test_a_second_signal_does_not_disturb_the_clean_up():
    clean_up = "print('cleaning', flush=True)", "time.sleep(0.3)", "print('done')"
    program = _interrupted(READY, after=clean_up)
    ended = _stopped(program, signal.SIGINT, signal.SIGINT)
    assert (ended.returncode, ended.stdout) == (0, "ready\ncleaning\ndone\n")


@pytest.mark.parametrize(
    "work",
    [
        "hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)",  # compiled code, for minutes
        "time.sleep(60)",
    ],
)
def test_what_does_not_stop_is_ended(work):
    program = (
        f"import hashlib, time\n{LISTEN}\n"
        "is_ready = False\n"
        "while True:\n"
        "    try:\n"
        "        if not is_ready:\n"
        "            is_ready = True\n"
        f"            {READY}\n"
        f"        {work}\n"
        "    except BaseException:\n"
        "        pass\n"
    )
    ended = _stopped(program, signal.SIGINT)
    assert ended.returncode == 130
    assert ended.stderr.startswith("interrupted: ended at once")


def test_an_interruption_is_one_json_object(capsys):
    @format_option
    def command(style):
        raise Interrupted(kept="2 finished runs", missing="replay 0003 has no result")

    with pytest.raises(Interrupted):
        command(style="json")
    assert json.loads(capsys.readouterr().out) == {
        "interrupted": True,
        "kept": "2 finished runs",
        "missing": "replay 0003 has no result",
    }
    with pytest.raises(Interrupted):
        command(style="text")
    assert capsys.readouterr().out == ""
