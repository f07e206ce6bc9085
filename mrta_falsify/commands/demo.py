"""The main job in miniature on the AWS hospital."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mrta_falsify.campaigns.settings import DEFAULTS, Limits
from mrta_falsify.commands.campaign import (
    CampaignResult,
    OnFeedback,
    OnRecord,
    open_store,
    run_store,
)
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.report.writing import write_reports
from mrta_falsify.commands.run import RunFiles, run, write_run
from mrta_falsify.commands.stacks import Stack, load_stack
from mrta_falsify.commands.workers import local_workers
from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core.config import StackConfig

if TYPE_CHECKING:
    from mrta_falsify.core.world import World
    from simulator_interface.simulate import Outcome

DEMO_WORLD = "aws_hospital_day"
WARM_UP = 20.0  # s simulated before anything is timed, so that all compiled code is loaded
WORKERS = 2  # processes of a search


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoSearch:
    """A short campaign of the demo."""

    name: str  #: of its directory
    scenario: str
    trials: int  #: at most
    settings: tuple[str, ...] = ()  #: of the stack
    specifications: tuple[str, ...] = ()  #: those of campaigns if empty
    stop_after: int = 0


SAMPLED_DAYS = DemoSearch(name="campaign", scenario="hospital_day", trials=8)
#: a published controller without priorities, in a scenario in which robots meet head on
EXAMPLE = DemoSearch(
    name="example",
    scenario="opposing_flows",
    trials=12,
    settings=("controller=decentralised_cbf", "controller.share=0.5"),
    specifications=("no_deadlock",),
    stop_after=1,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DemoDay:
    """The fixed day in PyBullet."""

    outcome: Outcome
    files: RunFiles


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DemoResult:
    """What the demo has shown."""

    day: DemoDay
    campaign: CampaignResult  #: on the stack given
    example: CampaignResult  #: on a stack that deadlocks
    report: Path  #: of the campaign, if it found a failure; else of the example


def demo(
    *,
    seed: int = DEFAULTS.trials.seed,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    output: Place = "demo-run",
) -> DemoResult:
    """Run one day in PyBullet, search sampled days, and search a stack that deadlocks.

    Args:
        seed: of the day and of both campaigns.
        stack: the stack under test, or its YAML file; the default stack if None.
        settings: ``--set`` texts applied to the stack.
        output: directory for everything.

    Raises:
        KeyboardInterrupt: a part was interrupted.
    """
    config, folder = load_stack(stack, settings), Path(output)
    world = find_world(DEMO_WORLD, seed=seed)
    load_compiled_code(world, config)
    day = run_day(world, config, folder / "day")
    results = []
    for search in (SAMPLED_DAYS, EXAMPLE):
        results.append(run_search(search, seed, config, folder))
        if results[-1].ended == "interrupted":
            raise KeyboardInterrupt
    return DemoResult(
        day=day,
        campaign=results[0],
        example=results[1],
        report=write_failure_report(results, folder),
    )


def load_compiled_code(world: World, config: StackConfig) -> float:
    """Load or compile what a run needs, and return the seconds that took.

    A run that is timed afterwards spends its time on simulation.
    """
    began = time.perf_counter()
    run(dataclasses.replace(world, horizon=WARM_UP), config, keep_trace=False)
    return time.perf_counter() - began


def run_day(
    world: World,
    config: StackConfig,
    directory: Path,
    *,
    on_progress: Callable[[float], None] | None = None,
) -> DemoDay:
    """Run the fixed day and write its files."""
    outcome = run(world, config, on_progress=on_progress)
    return DemoDay(outcome=outcome, files=write_run(outcome, world, directory, config=config))


def run_search(
    search: DemoSearch,
    seed: int,
    config: StackConfig,
    directory: Path,
    *,
    on_record: OnRecord = lambda record, is_new: None,
    on_feedback: OnFeedback = lambda record, progress: None,
) -> CampaignResult:
    """Run a search of the demo, or what is missing of it."""
    folder = directory / search.name
    chosen = new_settings(
        search.scenario,
        output=folder,
        stack=config,
        settings=search.settings,
        specs=search.specifications,
        seed=seed,
        screen=True,
    )
    limits = Limits(budget=search.trials, stop_after=search.stop_after)
    with open_store(folder, dataclasses.replace(chosen, budget=search.trials)) as store:
        return run_store(
            store, limits, local_workers(WORKERS), on_record=on_record, on_feedback=on_feedback
        )


def write_failure_report(results: Sequence[CampaignResult], directory: Path) -> Path:
    """Write the report of the first campaign with a failure, or of the last one."""
    failing = (result for result in results if result.progress.failed)
    chosen = next(failing, results[-1])
    (page, *_) = write_reports(chosen.campaign.directory, directory / "report.html")
    return page.resolve()
