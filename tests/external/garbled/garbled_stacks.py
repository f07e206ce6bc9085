"""Whole episodes whose stack answers garbled messages: told, and by processes of their own."""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.seeding import stream
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.specs.library import build_specifications, default_specifications
from simulator_interface.episode import Episode
from simulator_interface.external.answers import FARTHEST, read_ready
from simulator_interface.external.branching import CannotBranch
from simulator_interface.external.transcript import Transcript, TranscriptRecorder
from simulator_interface.simulate import simulate
from tests.external.garbled.garbling import Garbled, framed, garbled, packed
from tests.external.garbled.rightful import Message, command_message, hall, ready_message
from tests.external.garbled.tally import Tally, no_sentence
from tests.external.marked import marked

ROOT = Path(__file__).resolve().parents[3]
TICKS = 40  # of an episode that is told
EXTREMES = (0.0, FARTHEST, -FARTHEST, 5e-324, 1e3, -1e3)
FREE = (*EXTREMES, 1e100, -1e100)  # numbers of no unit
UNKNOWN = (float("nan"), float("inf"), float("-inf"))  # allowed where nothing has to be finite
LARGEST = 2**31 - 1
WORDS = ("robot1", "robot2", "", "\x00", "é", "a" * 600, "<script>", "picked-up", "dropped-off")
MARK = "MRTA_FUZZ"  # of the processes of one call, in their environment


def told_episodes(count: int, seed: int, folder: Path) -> Tally:
    """Tell episodes answers that are odd but allowed, and at last a garbled one."""
    del folder
    tally, random = Tally(), stream(seed, "fuzz/told")
    while tally.messages < count:
        engine = "bullet" if random.random() < 0.3 else "kinematic"
        binary = bool(random.integers(2))
        answers, odd = [], 0
        for tick in range(TICKS):
            message = command_message(random, binary=True, tick=tick)
            if random.random() < 0.3:
                message, odd = extreme(message, random), odd + 1
            answers.append(_encoded(message, binary))
        made = garbled(
            command_message(random, binary=binary, tick=TICKS - 1), random, binary=binary
        )
        answers[-1] = made.body
        tally.messages += odd  # and the last
        told = told_of(answers, "msgpack" if binary else "json")
        tally.take(made, functools.partial(judged, told, engine))
    return tally


def _encoded(message: Message, binary: bool) -> bytes:
    if binary:
        return packed(message, binary=True)
    shapes = {"twist": 3, "goal": 2, "waypoint": 2}
    plain = {
        key: _lists(value, shapes.get(key, 0)) if isinstance(value, bytes) else value
        for key, value in message.items()
    }
    plain["paths"] = [[robot, _lists(path, 2)] for robot, path in message["paths"]]
    return packed(plain, binary=False)


def _lists(blob: bytes, width: int) -> list:
    array = np.frombuffer(blob)
    return (array.reshape(-1, width) if width else array).tolist()


def extreme(message: Message, random: np.random.Generator) -> Message:
    """Go to the ends of what the protocol allows."""

    def numbers(count: int, *more: float) -> np.ndarray:
        return random.choice([*EXTREMES, *more], size=count)

    def free() -> float:
        return float(random.choice(FREE))

    def word() -> str:
        return WORDS[random.integers(len(WORDS))]

    changes: tuple[Message, ...] = (
        {"twist": numbers(6).tobytes()},
        {"goal": numbers(4, *UNKNOWN).tobytes()},
        {"paths": [[int(random.integers(2)), numbers(2 * int(random.integers(9))).tobytes()]]},
        {"waypoint": numbers(4, *UNKNOWN).tobytes()},
        {"slack": numbers(2, *FREE, *UNKNOWN).tolist()},
        {"stops_left": [LARGEST, int(random.integers(3))], "queue": [LARGEST, -1]},
        {"leader": [1, 0], "cluster": [0, 0], "phase": random.integers(0, 4, size=2).tolist()},
        {"took": float(random.choice([0.0, 0.05, 600.0, 5e-324]))},
        {"signals": {word(): free(), "gain": -1e100}},
        {"waits_for": [[0, word()], [1, word()], [0, word()]]},
        {
            "events": [
                {"kind": word(), "robot": int(random.integers(-1, 2)), "resource": word(),
                 "task": int(random.integers(-1, 2)), "other": 2**20 - 1, "detail": word()}
                for _ in range(int(random.integers(30)))
            ]
        },
    )  # fmt: skip
    return {**message, **changes[random.integers(len(changes))]}


def told_of(answers: list[bytes], encoding: str) -> Transcript:
    recorder = TranscriptRecorder(read_ready({**ready_message(), "encoding": encoding}))
    for body in answers:
        recorder.add(body)
    return recorder.finish()


def judged(transcript: Transcript, engine: str) -> str:
    """Run and judge an episode; its verdicts must be writable."""
    stack = ExternalStack(command=("none",))
    config = dataclasses.replace(StackConfig(), engine=Choice(engine), stack=stack)
    outcome = simulate(
        hall(),
        config,
        specifications=build_specifications(default_specifications()),
        transcript=transcript,
    )
    json.dumps(codec.encode(outcome.verdicts)).encode()
    failure = next((v.evidence["message"] for v in outcome.verdicts if v.spec == "stack_runs"
                    and v.violated), "")  # fmt: skip
    wrong = no_sentence(failure) if failure else ""
    assert not wrong, f"{wrong}: {failure[:200]!r}"
    if not failure:
        return "taken"
    return "refused" if len(outcome.trace) >= TICKS - 1 else "refused before the last"


# --- processes -------------------------------------------------------------------------------


def as_processes(count: int, seed: int, folder: Path) -> Tally:
    """Run processes of a stack that sends one garbled message, some with children."""
    del folder
    tally, mark = Tally(), f"{os.getpid()}-{time.monotonic_ns()}"
    for number in range(count):
        tally.take(
            Garbled("garbling_stack", framed(f"{seed} {number}".encode())),
            functools.partial(asked, seed, number, mark),
        )
    left = left_with(mark)
    if left:
        tally.defects.append(f"{len(left)} processes are left: {left}")
    return tally


def asked(seed: int, number: int, mark: str) -> str:
    """Run an episode with a stack that garbles; a copy of it now and then."""
    stack = ExternalStack(
        command=(
            sys.executable,
            "-m",
            "tests.external.garbled.garbling_stack",
            str(seed),
            str(number),
        ),
        folder=str(ROOT),
        env={"PYTHONPATH": str(ROOT), MARK: mark},
        tick_limit=1.0,
        start_limit=20.0,
    )
    config = dataclasses.replace(StackConfig(), engine=Choice("kinematic"), stack=stack)
    if number % 4 == 3:
        return copied(config)
    outcome = simulate(dataclasses.replace(hall(), horizon=0.5), config)
    for verdict in outcome.verdicts:
        if verdict.violated:
            wrong = no_sentence(verdict.evidence["message"])
            assert not wrong, f"{wrong}: {verdict.evidence['message'][:200]!r}"
            return str(verdict.evidence["kind"])
    return "taken"


def copied(config: StackConfig) -> str:
    """Go on in a copy of the run, whose stack garbles the answer to `branch`."""
    episode = Episode(hall(), config)
    frames = episode.frames()

    def apart() -> str:
        try:
            episode.become_copy()
        except CannotBranch as error:
            return str(error)
        for _ in range(3):
            next(frames)
        return "copied"

    try:
        for _ in range(5):
            next(frames)
        said = str(run_supervised(apart))
    finally:
        frames.close()
    assert not no_sentence(said), said
    return said if said == "copied" else "not copied"


def left_with(mark: str, patience: float = 5.0) -> list[int]:
    """Find processes with a mark in their environment that do not end within ``patience`` s."""
    until = time.monotonic() + patience
    while True:
        found = marked(f"{MARK}={mark}")
        if not found or time.monotonic() > until:
            return found
        time.sleep(0.05)
