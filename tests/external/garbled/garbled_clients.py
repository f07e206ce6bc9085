"""Client libraries that hear a garbled harness."""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mrta_falsify.core.seeding import stream
from simulator_interface.clients.mrta_stack import serve
from tests.external.garbled import reading_stack, rightful
from tests.external.garbled.garbling import Garbled, framed, garbled, packed
from tests.external.garbled.tally import Tally, no_sentence

HERE = Path(__file__).parent
CLIENTS = HERE.parents[2] / "simulator_interface" / "clients"
LIMIT = 20.0  # s until a client has ended, on a busy machine
SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g")
WHERE = ("hello", "world", "tick", "tick", "path")
PATH = {"type": "path", "points": bytes(64), "reason": ""}


def talk(random: np.random.Generator, where: str) -> tuple[Garbled, bytes]:
    """Garble one message of what a harness says in an episode; that one, and all of it."""
    hello, world = _opening()
    said = [("hello", hello), ("world", world)]
    for number in range(3):
        said += [("tick", rightful.tick(number)), ("path", PATH)]
    if where == "branch":
        said.insert(4, ("branch", {"type": "branch", "address": "/nowhere/at/all"}))
    position = next(i for i, (kind, _) in enumerate(said) if kind == where)
    made = garbled(said[position][1], random, binary=where != "hello")
    frames = [framed(packed(message, binary=kind != "hello")) for kind, message in said]
    frames[position] = made.frame
    return made, b"".join(frames)


@functools.cache
def _opening() -> tuple[rightful.Message, rightful.Message]:
    return rightful.opening()


# --- in this process ---------------------------------------------------------------------------


def in_process(count: int, seed: int, folder: Path) -> Tally:
    """Let the Python client hear a garbled harness, in this process."""
    del folder
    tally, random = Tally(), stream(seed, "fuzz/python")
    for number in range(count):
        made, said = talk(random, WHERE[number % len(WHERE)])
        tally.take(made, functools.partial(served, said))
    return tally


def served(said: bytes) -> str:
    """Say something to the Python client and close; how it ends."""
    ours, theirs = socket.socketpair()
    os.environ["MRTA_STACK_FD"] = str(theirs.detach())
    speaker = threading.Thread(target=_speak, args=(ours, said))
    speaker.start()
    code = _code_of(lambda: serve(reading_stack.Reading, name="reads"))
    speaker.join()
    ours.close()
    if code is None:
        return "ended in peace"
    wrong = no_sentence(str(code))
    assert not wrong, f"{wrong}: {code!r:.200}"
    return "refused"


def _code_of(call: Callable[[], None]) -> object:
    """Give what a call ends the program with, None: nothing."""
    try:
        call()
    except SystemExit as error:
        return error.code
    return None


def _speak(link: socket.socket, said: bytes) -> None:
    """Say all, and hear what comes back to its end."""
    listener = threading.Thread(target=_listen, args=(link,))
    listener.start()
    with contextlib.suppress(OSError):  # the client has closed the connection
        link.sendall(said)
        link.shutdown(socket.SHUT_WR)
    listener.join()


def _listen(link: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while link.recv(1 << 16):
            pass


# --- as processes --------------------------------------------------------------------------------


def as_processes(language: str, count: int, seed: int, folder: Path) -> Tally:
    """Let processes of a client hear a garbled harness."""
    tally, random = Tally(), stream(seed, f"fuzz/{language}")
    command = (
        built(folder) if language == "cpp" else (sys.executable, str(HERE / "reading_stack.py"))
    )
    if command is None:
        return tally
    for number in range(count):
        made, said = talk(random, (*WHERE, "branch")[number % (len(WHERE) + 1)])
        tally.take(made, functools.partial(ended, command, said))
    return tally


def built(folder: Path) -> tuple[str, ...] | None:
    """Compile the C++ client with the sanitizers, if there are any; None: there is no compiler."""
    compiler = shutil.which("c++")
    if compiler is None:
        return None
    program = folder / "reading_stack"
    plain = [compiler, "-std=c++17", "-O1", f"-I{CLIENTS}", "-o", str(program)]
    source = str(HERE / "reading_stack.cpp")
    for flags in (SANITIZE, ()):
        made = subprocess.run([*plain, *flags, source], capture_output=True, text=True, check=False)
        if made.returncode == 0:
            return (str(program),)
    raise RuntimeError(made.stderr)


def ended(command: tuple[str, ...], said: bytes) -> str:
    """Say something to a client's process and close; how it ends."""
    ours, theirs = socket.socketpair()
    environment = {**os.environ, "MRTA_STACK_FD": str(theirs.fileno()),
                   "PYTHONPATH": str(CLIENTS)}  # fmt: skip
    with subprocess.Popen(
        command, env=environment, pass_fds=(theirs.fileno(),), stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        theirs.close()
        speaker = threading.Thread(target=_speak, args=(ours, said))
        speaker.start()
        try:
            _, printed = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            process.kill()
            printed = f"it had not ended after {LIMIT:g} s"
        speaker.join()
        ours.close()
    if process.returncode == 0 and not printed:
        return "ended in peace"
    wrong = no_sentence(printed)
    assert process.returncode == 1, f"exit code {process.returncode}: {printed[-600:]}"
    assert not wrong, f"{wrong}: {printed[-600:]}"
    return "refused"
