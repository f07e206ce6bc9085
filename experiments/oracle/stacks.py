"""Stacks under test of the labelled set."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.testing.stacks import ALONE, BRAKE, SHARED, SYMMETRIC, stack
from simulator_interface import clients


def any_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """One of the controllers; the default one most often."""
    pick = int(random.integers(8))
    if pick == 0:
        return stack(priority_rule=Choice("distance_to_goal"), **layers)
    return stack(
        (None, None, None, None, BRAKE, SHARED, SYMMETRIC, ALONE)[pick],
        **layers,
    )


def weak_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """One of the controllers that do not plan for others."""
    return stack((BRAKE, SHARED, SYMMETRIC, ALONE)[int(random.integers(4))], **layers)


def mixed_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """Mostly one of the controllers that do not plan for others: robots get stuck more often."""
    return (weak_stack if random.random() < 0.65 else any_stack)(random, **layers)


# --- stacks outside -----------------------------------------------------------------------------

OUTSIDE = Path(__file__).parent / "outside"
NEVER = 1e9  # s, of a timer that does not end within a run


def outside(random: np.random.Generator, program: str, **params: float | str) -> StackConfig:
    """One of the stacks in :mod:`experiments.oracle.outside`, mostly with copies of it.

    Its client is the file that ``init --stack python`` copies; it is imported from where that
    takes it.

    Args:
        random: decides how it is copied and what it shows.
        program: ``locks``, ``timers`` or ``lanes``.
        params: of the stack.
    """
    shown = {"shows_phases": int(random.random() < 0.5), "shows_waits": int(random.random() < 0.3)}
    branch = str(random.choice(["auto", "auto", "auto", "auto", "replay", "never", "never"]))
    process = ExternalStack(
        command=(sys.executable, f"{program}.py"),
        folder=str(OUTSIDE),
        env={"PYTHONPATH": str(Path(clients.__file__).parent)},
        params={**params, **shown},
        branch=branch,
    )
    return stack(stack=process)


def with_state_file(config: StackConfig, path: Path) -> StackConfig:
    """Let a foreign stack write down why its robots stand, and be copied by fork."""
    assert config.stack is not None
    env = {**config.stack.env, "MRTA_ORACLE_STATE": str(path)}
    return dataclasses.replace(
        config, stack=dataclasses.replace(config.stack, env=env, branch="fork")
    )


def is_ours(config: StackConfig) -> bool:
    """Whether a foreign stack is one that writes down why its robots stand."""
    programs = {path.name for path in OUTSIDE.glob("*.py")} - {"driving.py"}
    if config.stack is None or Path(config.stack.folder).resolve() != OUTSIDE.resolve():
        return False
    return any(Path(word).name in programs for word in config.stack.command)


def identity(config: StackConfig) -> str:
    """Digest of a configuration that does not depend on where things are on the machine."""
    if config.stack is None:
        return config.digest()
    program = Path(config.stack.command[-1]).name
    process = dataclasses.replace(config.stack, command=(program,), folder="", env={})
    return dataclasses.replace(config, stack=process).digest()


def clock_of(config: StackConfig) -> float:
    """For how long timers of a foreign stack may run while nothing moves [s]; 0: none that ends."""
    params = config.stack.params if config.stack else {}
    patience = float(params.get("patience", 0.0))
    in_a_row = 2.0 if config.stack and config.stack.command[-1] == "lanes.py" else 1.0
    return in_a_row * patience if patience < NEVER else 0.0


def timed_until(config: StackConfig) -> float:
    """When the last timer set to a moment has ended [s]."""
    end = float(config.stack.params.get("end", 0.0)) if config.stack else 0.0
    return end if end < NEVER else 0.0
