"""Processes at a commit: where they run, how a stack is built, and their end on Ctrl-C."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

STOPS = (signal.SIGINT, signal.SIGTERM)
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
    # A stop in between would leave a process that nobody knows of; it comes a moment later.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
    allow = functools.partial(signal.pthread_sigmask, signal.SIG_SETMASK, before)
    try:
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
            preexec_fn=allow,  # noqa: PLW1509 - one system call, and no lock is taken
        )
    except BaseException:
        allow()
        raise
    try:
        allow()
        said, complaint = process.communicate()
    finally:
        if process.poll() is None:
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
