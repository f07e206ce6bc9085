"""What a foreign stack does wrong is a verdict about it, in words."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.world import RobotSpec, World
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.process.watch import Watch, under
from simulator_interface.episode import Episode
from simulator_interface.external import session
from simulator_interface.external.branching import CannotBranch
from simulator_interface.external.process import named_in
from simulator_interface.simulate import simulate
from tests.external.marked import marked

ROOT = Path(__file__).resolve().parents[2]
BAD = Path(__file__).with_name("bad_stack.py")
AT = 5  # tick at which it fails

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


@pytest.fixture(scope="module")
def hall() -> World:
    robots = tuple(
        RobotSpec(name=f"robot{i + 1}", pose=np.array([2.0 * i, 0.0, 0.0])) for i in range(2)
    )
    return World(name="hall", bounds=np.array([-3.0, -3.0, 6.0, 3.0]), robots=robots, horizon=1.0)


def bad(how: str, **more) -> StackConfig:
    stack = ExternalStack(
        command=(sys.executable, str(BAD), how, str(AT)),
        env={"PYTHONPATH": str(ROOT)},
        **{"tick_limit": 60.0, **more},
    )
    return dataclasses.replace(StackConfig(), engine=Choice("kinematic"), stack=stack)


def failure_of(hall: World, how: str, **more) -> dict:
    outcome = simulate(hall, bad(how, **more))
    (verdict,) = outcome.verdicts
    assert verdict.spec == "stack_runs"
    assert verdict.violated
    assert verdict.evidence["tick"] == AT
    assert len(outcome.trace) == AT
    return verdict.evidence


@pytest.mark.parametrize(
    ("how", "kind", "message", "printed"),
    [
        ("raise", "crash", "the stack ended by exit code 1", "RuntimeError: a bug of the stack's"),
        ("exit", "crash", "the stack ended by exit code 3", "about to exit"),
        ("abort", "crash", "the stack ended by SIGABRT", "about to abort"),
        ("signal", "crash", "the stack ended by signal 40", "about to signal"),
        ("ends slowly", "crash", "the stack ended by exit code 1", "RuntimeError: a bug of the"),
        ("closes", "crash", "the stack closed the connection", "about to closes"),
        ("nan", "answer", "twist of robot2 is (nan, 0, 0); it must be finite", "about to nan"),
        ("shape", "answer", "twist has 32 bytes; (2, 3) float64 are 48", "about to shape"),
        ("field", "answer", "twists is no field of the message; did you mean 'twist'?", "about"),
        ("event", "answer", "events has 99; it must be a whole number from -1 to 1", "about"),
        ("tick", "answer", "tick is 7; the harness sent tick 5", "about to tick"),
        ("prints", "answer", "is something printing to the connection?", "about to prints"),
    ],
)
def test_each_fault_is_a_verdict_with_what_was_wrong_and_what_was_printed(
    hall, how, kind, message, printed
):
    evidence = failure_of(hall, how)
    assert evidence["kind"] == kind
    assert message in evidence["message"]
    assert any(printed in line for line in evidence["frames"])


def test_crashes_are_told_apart_by_the_exception_that_the_last_words_name(hall):
    assert failure_of(hall, "raise")["exception"] == "RuntimeError"
    assert failure_of(hall, "exit")["exception"] == "exit code 3"


@pytest.mark.parametrize(
    ("lines", "name"),
    [
        (["IndexError: list index out of range"], "IndexError"),
        (["cvxpy.error.SolverError: failed", "bye"], "SolverError"),
        (["ProgramDied: program a died:", "KeyError: 'left'"], "KeyError"),
        (
            ["terminate called after throwing an instance of 'std::out_of_range'"],
            "std::out_of_range",
        ),
        (["An Error: no exception", "about to exit"], ""),
    ],
)
def test_an_exception_is_found_in_last_words(lines, name):
    assert named_in(lines) == name


@pytest.mark.parametrize("how", ["hang", "spin", "dawdles", "stops", "child spins"])
def test_no_answer_within_the_limit_is_a_hang(hall, how):
    evidence = failure_of(hall, how, tick_limit=0.5)
    assert evidence["kind"] == "hang"
    assert evidence["message"] == "the stack did not answer within 0.5 s"


def test_questions_without_end_are_no_answer(hall, monkeypatch):
    monkeypatch.setattr(session, "MAX_QUESTIONS", 20)
    evidence = failure_of(hall, "inquires")
    assert evidence["kind"] == "answer"
    assert evidence["message"] == "`tick` was answered by 20 questions"


def test_a_flood_of_output_is_cut_and_its_end_is_kept(hall):
    evidence = failure_of(hall, "floods")
    assert evidence["exception"] == "exit code 4"
    assert all(len(line) <= 300 for line in evidence["frames"])


@pytest.mark.parametrize("how", ["eats", "hoards", "child eats"])
def test_too_much_memory_is_seen_within_a_second(hall, how):
    limits = StackLimits(memory=0.3)
    with under(Watch(budget=Budget.of_stack(limits))):
        outcome = simulate(dataclasses.replace(hall, horizon=3.0), bad(how))
    (verdict,) = outcome.verdicts
    assert verdict.evidence["kind"] == "memory"
    assert verdict.evidence["message"] == "the stack took up more than 0.3 GiB of memory"
    assert AT <= verdict.evidence["tick"] <= AT + 20


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("refuses", "ended by exit code 1 before it was ready; it printed last: no world like"),
        ("asks", r"start is \[0.0, nan\]; it must be two finite numbers"),
        ("silent", r"was not ready within 1 s \(stack.start_limit\)"),
        ("old", "`ready`: protocol speaks version 9; this harness speaks 1"),
    ],
)
def test_what_fails_before_the_first_tick_is_bad_input(hall, how, message):
    with pytest.raises(ConfigError, match=message):
        simulate(hall, bad(how, start_limit=1.0 if how == "silent" else 60.0))


def test_a_program_that_cannot_be_run_is_bad_input(hall, tmp_path):
    (tmp_path / "stack").write_text("no program")
    config = dataclasses.replace(bad("nan"), stack=ExternalStack(command=(f"{tmp_path}/stack",)))
    with pytest.raises(ConfigError, match="stack: Permission denied"):
        simulate(hall, config)


def test_a_stack_that_starts_only_once_has_no_copy_by_replay_and_no_error(hall, tmp_path):
    config = bad("once", branch="replay")
    env = {**config.stack.env, "MARK": str(tmp_path / "mark")}
    stack = dataclasses.replace(config.stack, env=env)
    episode = Episode(hall, dataclasses.replace(config, stack=stack))
    frames = episode.frames()
    next(frames)

    def copied() -> str:
        try:
            episode.become_copy()
        except CannotBranch as error:
            return str(error)
        return ""

    said = run_supervised(copied)
    frames.close()
    assert said.startswith("a fresh process of the stack does not go on")


# --- nothing is left running ---------------------------------------------------------------


def wait_until(condition, seconds: float = 20.0) -> bool:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if condition():
            return True
        time.sleep(0.02)
    return False


@pytest.mark.parametrize("how", ["nan", "hang", "children"])
def test_nothing_that_a_stack_started_outlives_its_episode(hall, how):
    marker = f"MARK_OF_{how}_{os.getpid()}_{time.monotonic_ns()}"
    config = bad(how, tick_limit=0.5)
    stack = dataclasses.replace(config.stack, env={**config.stack.env, "MARKER": marker})
    simulate(hall, dataclasses.replace(config, stack=stack))
    assert wait_until(lambda: not marked(marker))


@pytest.mark.parametrize("how", ["hang", "children", "spin"])
def test_nothing_outlives_a_harness_that_is_killed(how):
    marker = f"MARK_OF_{how}_{os.getpid()}_{time.monotonic_ns()}"
    program = (
        "import dataclasses, numpy as np\n"
        "from mrta_falsify.core.world import RobotSpec, World\n"
        "from simulator_interface.simulate import simulate\n"
        "from tests.external.test_faults import bad\n"
        "robots = (RobotSpec(name='robot1', pose=np.zeros(3)),)\n"
        "world = World(name='hall', bounds=np.array([-3.0, -3.0, 6.0, 3.0]), robots=robots,\n"
        "              horizon=1e5)\n"
        f"config = bad({how!r}, tick_limit=1000.0)\n"
        f"env = {{**config.stack.env, 'MARKER': {marker!r}}}\n"
        "stack = dataclasses.replace(config.stack, env=env)\n"
        "simulate(world, dataclasses.replace(config, stack=stack))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    harness = subprocess.Popen([sys.executable, "-c", program], env=environment, cwd=ROOT)
    try:
        assert wait_until(lambda: len(marked(marker)) >= (3 if how == "children" else 1), 60.0)
        time.sleep(0.3)
    finally:
        harness.send_signal(signal.SIGKILL)
        harness.wait()
    assert wait_until(lambda: not marked(marker))
