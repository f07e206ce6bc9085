"""Exit codes and error texts: the one place where exceptions become sentences."""

from __future__ import annotations

import enum
import errno
import os
import shlex
import sys
import tempfile
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

import click

from mrta_falsify.cli import stopping
from mrta_falsify.core.durable import CLOSED, DISK, place_error, place_error_in
from mrta_falsify.core.errors import InputError, InputNote, NeedsOption, PlaceError
from mrta_falsify.core.interruption import Interrupted, propagate_interrupts

STDOUT, STDERR = 1, 2  # file descriptors

#: errors of a place that the user gave, not of the toolkit
PLACE_ERRORS = (
    CLOSED
    | DISK
    | {errno.ENOENT, errno.EISDIR, errno.ENOTDIR, errno.ENOTEMPTY, errno.ELOOP, errno.ENAMETOOLONG}
)
ROOT = Path(__file__).parents[1]  # what is missing in it is the toolkit's fault


class ExitCode(enum.IntEnum):
    """What the exit code of every command means."""

    DONE = 0  #: nothing violated, or the command did its work
    VIOLATED = 1  #: a specification is violated
    BAD_INPUT = 2  #: the user's input or usage is wrong
    HARNESS = 3  #: the toolkit itself failed
    INTERRUPTED = stopping.EXIT_CODE  #: Ctrl-C or SIGTERM


#: what they mean in one phrase each; a command may say more about 1 and 3
MEANINGS: dict[ExitCode, str] = {
    ExitCode.DONE: "nothing violated, or the command did its work",
    ExitCode.VIOLATED: "violations found",
    ExitCode.BAD_INPUT: "bad input or usage",
    ExitCode.HARNESS: "the toolkit itself failed",
    ExitCode.INTERRUPTED: "interrupted",
}


class Door(click.Group):
    """A command group whose failures end in one sentence and the right exit code."""

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command line and exit with its code."""
        if args is None:  # this process is the command
            stopping.listen()
        _keep_stdout_ours()
        try:
            code = self._exit_code(args, prog_name or "mrta-falsify", complete_var, extra)
        except KeyboardInterrupt:  # while the end was told
            code = ExitCode.INTERRUPTED
        stopping.stop_listening()
        if args is None and code == ExitCode.INTERRUPTED:
            stopping.leave()
        sys.exit(code)

    def _exit_code(
        self,
        args: Sequence[str] | None,
        prog_name: str,
        complete_var: str | None,
        extra: dict[str, Any],
    ) -> int:
        try:
            with propagate_interrupts(), warnings.catch_warnings():
                warnings.showwarning = _show_warning
                warnings.simplefilter("default", InputNote)
                result = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.stdout.flush()
        except click.exceptions.NoArgsIsHelpError as error:
            print(error.ctx.get_help() if error.ctx is not None else "")
            return ExitCode.DONE
        except click.UsageError as error:
            path = error.ctx.command_path if error.ctx is not None else prog_name
            _say(f"{path}: {error.format_message()} (see: {path} --help)")
            return ExitCode.BAD_INPUT
        except click.ClickException as error:
            _say(error.format_message())
            return ExitCode.BAD_INPUT
        except NeedsOption as error:
            given = sys.argv[1:] if args is None else args
            _say(f"{error}: {shlex.join([prog_name, *given, error.option])}")
            return ExitCode.BAD_INPUT
        except (InputError, PlaceError) as error:
            _say(str(error))
            return ExitCode.BAD_INPUT
        except (click.Abort, KeyboardInterrupt) as error:  # click's is the end of the input here
            _abandon_stdout()
            _say("interrupted" + (f": {error}" if isinstance(error, Interrupted) else ""))
            return ExitCode.INTERRUPTED
        except BrokenPipeError:
            _abandon_stdout()  # the reader of our output has gone
            return ExitCode.DONE
        except Exception as error:
            fault = _abandon_stdout() or _fault_of_place(error)
            if fault:
                _say(fault)
                return ExitCode.BAD_INPUT
            _say(
                f"the toolkit itself failed: {type(error).__name__}: {error}; "
                f"this is not a verdict about the stack. Traceback: {save_traceback(error)}"
            )
            return ExitCode.HARNESS
        return int(result) if isinstance(result, int) else ExitCode.DONE


def _keep_stdout_ours() -> None:
    """Send what C libraries print to stderr, as PyBullet does, so that stdout is only ours."""
    try:
        if sys.stdout.fileno() != STDOUT:
            return
    except (AttributeError, OSError, ValueError):
        return  # a test or a notebook collects the output
    sys.stdout.flush()
    ours = open(  # noqa: SIM115 - stays open for as long as the process runs
        os.dup(STDOUT),
        "w",
        buffering=1 if sys.stdout.isatty() else -1,
        encoding=sys.stdout.encoding,
        errors=sys.stdout.errors,
    )
    os.dup2(STDERR, STDOUT)
    sys.stdout = ours


def _abandon_stdout() -> str:
    """Flush what can be flushed; Python must not try again at exit, with a code of its own.

    Returns:
        Why stdout cannot be written; empty: it can.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return str(place_error("stdout", error))
    return ""


def _fault_of_place(error: Exception) -> str:
    """Say which place is at fault; empty: none is, or one of ours."""
    if isinstance(error, OSError) and error.filename and error.errno in PLACE_ERRORS:
        path = os.fsdecode(error.filename)
        is_ours = Path(path).is_relative_to(ROOT) and error.errno == errno.ENOENT
        return "" if is_ours else f"{path}: cannot be used: {error.strerror}"
    place = place_error_in(error)
    return str(place) if place else ""


def save_traceback(error: BaseException) -> Path | str:
    """Write the full traceback of ``error`` to a file; return its path, or why there is none."""
    try:
        handle, name = tempfile.mkstemp(prefix="mrta-falsify-", suffix="-traceback.txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f"command: {sys.argv}\n\n")
            traceback.print_exception(error, file=file)
    except OSError as full:
        return f"could not be written to {tempfile.gettempdir()}: {full.strerror}"
    return Path(name)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print what readers note as a note, and other warnings as Python does."""
    if issubclass(category, InputNote):
        click.echo(f"note: {' '.join(str(message).split())}", err=True)
    else:
        text = warnings.formatwarning(message, category, filename, lineno, line)
        (file or sys.stderr).write(text)


def _say(text: str) -> None:
    one_line = " ".join(text.split())
    click.echo(one_line if one_line.startswith("interrupted") else f"error: {one_line}", err=True)
