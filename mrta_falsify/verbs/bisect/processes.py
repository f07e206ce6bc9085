"""Processes at a commit: where they run, how a stack is built, and their end on Ctrl-C."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from mrta_falsify.core.interruption import signals_held

PATIENCE = 0.6  # s for a process to end after SIGTERM
LAST_LINES = 3  # of a build's output, that say why it failed


def folder_as_of(top: Path, worktree: Path) -> Path:
    """Give the current folder in a worktree; its top where ours is no folder of the commit."""
    folder = Path.cwd().resolve()
    within = worktree / folder.relative_to(top) if folder.is_relative_to(top) else worktree
    return within if within.is_dir() else worktree


def run_to_end(
    words: Sequence[str], *, folder: Path, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command, out of reach of Ctrl-C; end it and what it has started when we are stopped.

    Args:
        words: the program and its arguments.
        folder: it runs in.
        env: its environment; ours if None.

    Raises:
        OSError: there is no such program, or it cannot be run.
    """
    hear = functools.partial(
        signal.pthread_sigmask, signal.SIG_SETMASK, signal.pthread_sigmask(signal.SIG_BLOCK, ())
    )
    process: subprocess.Popen[str] | None = None
    try:
        with signals_held():  # a stop in between would leave a process that nobody knows of
            process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                cwd=folder,
                env=env,
                start_new_session=True,
                preexec_fn=hear,  # noqa: PLW1509 - one system call, and no lock is taken
            )
        said, complaint = process.communicate()
    finally:
        if process is not None and process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE)
            with contextlib.suppress(ProcessLookupError):  # all of them have ended
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return subprocess.CompletedProcess(words, process.returncode, said, complaint)


def failed_build(words: Sequence[str], folder: Path) -> str:
    """Build a stack, and say why that failed; empty if it did not.

    Args:
        words: the command that builds it.
        folder: of the worktree, that it runs in.
    """
    try:
        done = run_to_end(words, folder=folder)
    except OSError as error:
        return f"the build cannot be run: {words[0]}: {error.strerror}"
    if not done.returncode:
        return ""
    lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    said = "; ".join(lines[-LAST_LINES:]) or "it said nothing"
    return f"the build failed with exit code {done.returncode}: {said}"
