"""Experiments of a campaign's trials: as its settings say, and as a record tells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mrta_falsify.campaigns.settings import TrialSettings
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.world import World
from mrta_falsify.lab.experiment import Experiment, SceneSource
from mrta_falsify.trial import campaign_specifications, on_kinematic_engine

if TYPE_CHECKING:
    from scenic_worlds.program import Program


def open_program(settings: TrialSettings) -> Program:
    """Compile a campaign's scenario.

    Raises:
        InputError: it does not compile, or is not the one the campaign began with.
    """
    return _compiled(settings.scenario, settings.params, settings.sources_digest)


def _compiled(scenario: str, params: dict[str, Any], sources_digest: str) -> Program:
    from scenic_worlds import program  # noqa: PLC0415 - Scenic takes seconds to import

    compiled = program.compile_program(program.scenario_path(scenario), params)
    if sources_digest and compiled.sources_digest != sources_digest:
        raise InputError(
            f"{scenario}: the program (or a file it imports) has changed since the "
            "campaign began; undo the change, or begin a new campaign"
        )
    return compiled


def draw_scene(source: SceneSource) -> Any:
    """Draw Scenic's scene again.

    Raises:
        InputError: the program does not compile, or has changed.
    """
    compiled = _compiled(source.program, source.params, source.sources_digest)
    return compiled.realise(source.candidate, mode=source.mode).scene


def specifications_of(settings: TrialSettings) -> tuple[str, ...]:
    """List what the trials of a campaign are judged by."""
    return settings.specifications or campaign_specifications(settings.stack)


def stack_of(settings: TrialSettings, record: TrialRecord) -> StackConfig:
    """Put the campaign's stack on the engine that a record's verdicts come from."""
    if record.engine in ("", settings.stack.engine.name):
        return settings.stack
    return on_kinematic_engine(settings.stack)


def experiment_of_trial(
    settings: TrialSettings, world: World, stack: StackConfig, candidate: Candidate | None = None
) -> Experiment:
    """Describe a run of a world under a campaign's specifications and limits.

    Args:
        settings: of the campaign.
        world: that is run.
        stack: under test.
        candidate: that the world was made of; None: it needs no Scenic program.
    """
    source = None
    if world.scripted and candidate is not None:
        source = SceneSource(
            program=settings.scenario,
            params=settings.params,
            sources_digest=settings.sources_digest,
            candidate=candidate,
            mode=settings.mode,
        )
    return Experiment(
        world=world,
        stack=stack,
        specs=specifications_of(settings),
        then=settings.then,
        early_stop=settings.early_stop,
        limits=settings.limits,
        scene=source,
    )


def experiment_of_record(settings: TrialSettings, record: TrialRecord, world: World) -> Experiment:
    """Describe a recorded trial's run, on the engine its verdicts come from.

    Args:
        settings: of its campaign.
        record: of the trial.
        world: its world.
    """
    return experiment_of_trial(settings, world, stack_of(settings, record), record.candidate)
