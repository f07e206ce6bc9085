"""A stack whose threads race is found out: the first tick at which its runs differ is named."""

from __future__ import annotations

import dataclasses
import itertools
import sys
from pathlib import Path

import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.difference import first_difference
from mrta_falsify.core.external import ExternalStack
from simulator_interface.simulate import simulate
from tests.external.garbled.rightful import hall

ROOT = Path(__file__).resolve().parents[2]
RUNS = 6  # of which two differ; each has a hundred races

pytestmark = [
    pytest.mark.long,  # whole runs
    pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux"),
]


def test_the_first_tick_that_a_race_changed_is_named():
    stack = ExternalStack(
        command=(sys.executable, "-m", "tests.external.racing_stack"),
        folder=str(ROOT),
        env={"PYTHONPATH": str(ROOT)},
    )
    config = dataclasses.replace(StackConfig(), engine=Choice("kinematic"), stack=stack)
    world = dataclasses.replace(hall(), horizon=5.0)
    outcomes = [simulate(world, config) for _ in range(RUNS)]
    pairs = [
        (one, other)
        for one, other in itertools.combinations(outcomes, 2)
        if one.trace.digest != other.trace.digest
    ]
    assert pairs, "no race was lost; the test shows nothing"
    one, other = pairs[0]
    answers = zip(one.transcript.answers(), other.transcript.answers(), strict=True)
    first = next(tick for tick, (heard, again) in enumerate(answers) if heard != again)
    difference = first_difference(one.trace, other.trace)
    assert (difference.tick, difference.who) == (first, "robot1")
