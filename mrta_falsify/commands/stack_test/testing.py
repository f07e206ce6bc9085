"""Does a foreign stack keep to the protocol of docs/door.md, and how fast is it?

Each check starts the stack anew. Those that look at single messages talk to its process; the others
run episodes with three robots on the kinematic engine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from mrta_falsify.commands.bench.bench_worlds import fleet_world
from mrta_falsify.commands.stack_test import conversing, episodes
from mrta_falsify.commands.stack_test.episodes import Failed, TickTime
from mrta_falsify.commands.stacks import Stack, is_process, load_stack
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError, InputError
from mrta_falsify.core.external import EXEC
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.core.world import World
from scenic_worlds.layouts import load_world

WORLD = "aws_hospital_day"
ROBOTS = 3  # of the checks
FLEETS = (6, 24, 100)  # whose ticks are timed

Outcome = Literal["ok", "failed", "skipped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DoorCheck:
    """One check of a stack."""

    name: str
    outcome: Outcome
    text: str  #: what was found, or what is wrong


@dataclass(frozen=True, slots=True, kw_only=True)
class DoorReport:
    """What ``stack-test`` found."""

    name: str  #: of the stack, as it says
    version: str
    says: tuple[str, ...]  #: names of what the stack reports
    can: tuple[str, ...]  #: names of what it can do
    checks: tuple[DoorCheck, ...]
    ticks: tuple[TickTime, ...]  #: none if a check failed

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.outcome != "failed" for check in self.checks)


def stack_test(
    command: str,
    *,
    robots: Sequence[int] = FLEETS,
    on_progress: Callable[[float], None] = lambda done: None,
) -> DoorReport:
    """Test a foreign stack.

    Args:
        command: that starts it, with or without ``exec:``, or a YAML file with ``stack:``.
        robots: numbers of robots with which its ticks are timed.
        on_progress: called after each check with how many are done.

    Raises:
        InputError: it cannot be started, or does not shake hands.
    """
    config = _config(command)
    world = fleet_world(load_world(WORLD), StackConfig(), ROBOTS)
    ready, starts = conversing.handshake(config, world)
    checks = [DoorCheck(name="starts and shakes hands", outcome="ok", text=starts)]
    for done, (name, check) in enumerate(CHECKS.items()):
        on_progress(done + 1)
        try:
            text = check(config, world, ready.can)
            outcome: Outcome = "ok" if text else "skipped"
        except (Failed, StackFailed, InputError) as error:
            text, outcome = str(error), "failed"
        checks.append(DoorCheck(name=name, outcome=outcome, text=text or "it does not say it can"))
    report = DoorReport(
        name=ready.name,
        version=ready.version,
        says=ready.says,
        can=ready.can,
        checks=tuple(checks),
        ticks=(),
    )
    if not report.passed:
        return report
    ticks = []
    for number, count in enumerate(robots):
        ticks.append(
            episodes.time_of_ticks(config, fleet_world(load_world(WORLD), StackConfig(), count))
        )
        on_progress(len(CHECKS) + number + 1)
    return dataclasses.replace(report, ticks=tuple(ticks))


def steps(robots: Sequence[int]) -> int:
    """Count the steps of a test, for a progress line."""
    return len(CHECKS) + len(robots)


Check = Callable[[StackConfig, World, tuple[str, ...]], str]

#: by name; each gives what it found, empty if it does not apply
CHECKS: dict[str, Check] = {
    "answers each tick as the protocol says": episodes.answers_each_tick,
    "gives the same answers again": episodes.answers_the_same,
    "goes on as a copy by fork": episodes.goes_on_by_fork,
    "goes on as a copy by replay": episodes.goes_on_by_replay,
    "ignores fields that it does not know": conversing.ignores_new_fields,
    "ends when it is told bye": conversing.ends_on_bye,
    "ends with the connection": conversing.ends_with_the_connection,
}


def _config(command: str) -> StackConfig:
    stack: Stack = command
    if not command.endswith((".yaml", ".yml")) and not is_process(command):
        stack = f"{EXEC}{command}"
    config = load_stack(stack)
    if config.stack is None:
        raise ConfigError(f"{command}: has no `stack:`, so no process to test")
    return dataclasses.replace(config, engine=Choice("kinematic"))
