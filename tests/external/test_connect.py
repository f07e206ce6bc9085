"""A stack that runs already is reached at its address, and outlives the episode."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import mrta_falsify as mf
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError, HarnessError
from mrta_falsify.core.external import parse_stack
from mrta_falsify.process.supervisor import run_supervised
from simulator_interface.episode import Episode
from simulator_interface.simulate import simulate

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux")


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as door:
        return door.getsockname()[1]


@contextlib.contextmanager
def running(address: str) -> Iterator[subprocess.Popen]:
    """A stack that listens at ``address``."""
    program = [sys.executable, str(Path(__file__).with_name("listening_stack.py")), address]
    stack = subprocess.Popen(program, env={**os.environ, "PYTHONPATH": str(ROOT)})
    try:
        yield stack
    finally:
        stack.kill()
        stack.wait()


def connected(address: str, **more) -> StackConfig:
    stack = dataclasses.replace(parse_stack(f"connect:{address}", where="here"), **more)
    return StackConfig(engine=Choice("kinematic"), stack=stack)


def reached(hall, address: str):
    """Run the hall's first second as soon as somebody listens."""
    world = dataclasses.replace(hall, horizon=1.0)
    until = time.monotonic() + 60.0
    while True:
        try:
            return simulate(world, connected(address))
        except ConfigError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)


@pytest.mark.parametrize("kind", ["socket", "port"])
def test_episodes_run_one_after_the_other_and_the_stack_goes_on(hall, tmp_path, kind):
    address = f"{tmp_path}/door" if kind == "socket" else f"127.0.0.1:{free_port()}"
    with running(address) as stack:
        first, again = reached(hall, address), reached(hall, address)
        assert stack.poll() is None
    assert first.trace.digest == again.trace.digest
    assert first.trace.columns["command"][3, 0, 2] == pytest.approx(0.04)
    assert not any(verdict.violated for verdict in first.verdicts)


@pytest.mark.parametrize("branch", ["fork", "replay"])
def test_copies_of_a_run_have_copies_of_the_stack(hall, tmp_path, branch):
    address = f"{tmp_path}/door"
    with running(address):
        reached(hall, address)
        episode = Episode(hall, connected(address, branch=branch))
        frames = episode.frames()
        for _ in range(5):
            next(frames)

        def turning() -> float:
            episode.become_copy()
            return float(next(frames).command.twist[0, 2])

        assert run_supervised(turning) == pytest.approx(0.06)
        assert next(frames).command.twist[0, 2] == pytest.approx(0.06)
        frames.close()


def test_a_stack_that_is_slow_is_never_judged_and_the_run_can_be_repeated(hall, tmp_path):
    address = f"{tmp_path}/door"
    world = dataclasses.replace(hall, horizon=1.0)
    slow = connected(address, params={"slow": True}, tick_limit=0.3)
    with running(address):
        usual = reached(hall, address)
        with pytest.raises(
            HarnessError, match=r"within 0.3 s of wall-clock time; it was not start"
        ):
            simulate(world, slow)
        again = simulate(world, connected(address, params={"slow": False}))
    assert not any(verdict.violated for verdict in again.verdicts)
    assert again.trace.digest == usual.trace.digest


def test_nothing_that_listens_is_bad_input(hall, tmp_path):
    with pytest.raises(ConfigError, match=r"cannot be reached: No such file or directory"):
        simulate(hall, connected(f"{tmp_path}/door"))


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("10.0.0.1:80", "the host '10.0.0.1' must be 127.0.0.1 or localhost"),
        ("localhost:http", "the port 'http' must be from 1 to 65535"),
        ("", "stack.command is empty"),
    ],
)
def test_only_this_machine_is_connected_to(address, message):
    with pytest.raises(ConfigError, match=message):
        connected(address)


def test_a_file_may_say_connect_but_not_a_command_as_well(tmp_path):
    file = tmp_path / "stack.yaml"
    file.write_text("stack: {connect: 127.0.0.1:7000}\n")
    assert mf.load_stack(file).stack.address() == ("127.0.0.1", 7000)
    file.write_text("stack: {connect: 127.0.0.1:7000, command: [sh]}\n")
    with pytest.raises(ConfigError, match="it must have one of them"):
        mf.load_stack(file)
