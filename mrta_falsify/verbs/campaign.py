"""Campaigns by name: begin, go on, list, show, replay; for the command line and Python."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.rare_events import estimated_probability, is_estimating
from mrta_falsify.campaigns.runner import Ended, Executor, Progress, run_campaign
from mrta_falsify.campaigns.settings import CampaignSettings, Limits, TrialSettings
from mrta_falsify.campaigns.statistics import failure_probability, why_no_probability
from mrta_falsify.campaigns.store import (
    SETTINGS,
    Campaign,
    Store,
    StoreError,
    read_campaign,
    read_campaign_settings,
)
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.difference import Difference, first_difference
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import cube_of
from mrta_falsify.core.findings import ReplayCheck
from mrta_falsify.core.record import TrialRecord, versions
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.world import World, read_world
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.trial import Job, Judged, campaign_specifications
from mrta_falsify.verbs import run as app
from mrta_falsify.verbs.check import check_params
from mrta_falsify.worker import open_program, rerun, specifications_of, stack_of

if TYPE_CHECKING:
    from scenic_worlds.program import Program

DEFAULT_SAMPLER = "auto"


def new_settings(
    scenario: str,
    *,
    directory: Path,
    config: StackConfig | None = None,
    params: dict[str, Any] | None = None,
    sampler: Choice | None = None,
    seed: int = 0,
    specifications: Sequence[str] = (),
    mode: Literal["repair", "exact"] = "repair",
    screen: bool = False,
    jittered: int = 0,
    early_stop: bool = True,
    window: int = 8,
    time_limit: float = 300.0,
) -> CampaignSettings:
    """Settings of a new campaign, everything in them checked.

    Args:
        scenario: shipped name or path of a Scenic program.
        directory: of the campaign.
        config: the stack under test.
        params: Scenic's global parameters to override.
        sampler: registered name and options.
        seed: of the campaign; candidate n gets its own from it.
        specifications: names, or ``stl:FORMULA``; the default ones of campaigns if empty.
        mode: how scenes are accepted, ``repair`` or ``exact``.
        screen: kinematic engine first, physics only for what fails there.
        jittered: copies with small differences that are run of each failing world.
        early_stop: end an episode once its verdict is decided.
        window: how far trials may run ahead of what the sampler knows.
        time_limit: wall clock of one trial [s].

    Raises:
        InputError: anything of it is wrong.
    """
    trials = TrialSettings(
        scenario=scenario,
        params=params or {},
        stack=config or StackConfig(),
        specifications=tuple(specifications) or campaign_specifications(),
        seed=seed,
        mode=mode,
        screen=screen,
        jittered=jittered,
        early_stop=early_stop,
        directory=str(directory.resolve()),
    )
    build_specifications(trials.specifications)
    program = open_program(trials)
    check_params(program, scenario)
    _check_first_scene(program, trials)
    settings = CampaignSettings(
        trials=dataclasses.replace(trials, sources_digest=program.sources_digest),
        sampler=sampler or Choice(DEFAULT_SAMPLER),
        cube=cube_of(program.space),
        window=window,
        time_limit=time_limit,
    )
    estimating = is_estimating(settings)  # builds the sampler, and so checks its options
    if estimating and jittered:
        raise InputError(
            f"jittered is {jittered}: a probability counts every failure, so sampler "
            f"{settings.sampler.name} takes no copies; it must be 0"
        )
    return settings


def _check_first_scene(program: Program, trials: TrialSettings) -> None:
    """Refuse a program whose first uniform candidate has a value that no world can have.

    A scene like that later in the campaign, where only some values are to blame, is a rejected
    trial with the same words; so is a candidate without a valid scene.

    Raises:
        InputError: names the program, the field and the value.
    """
    from scenic_worlds.program import RejectedScene  # noqa: PLC0415 - Scenic loads slowly

    with contextlib.suppress(RejectedScene), app.located(str(program.path)):
        program.realise(program.candidate(trials.seed), trials.mode)


def open_store(directory: Path, settings: CampaignSettings) -> Store:
    """A new campaign with ``settings``, or the one that is there, to go on with.

    Raises:
        StoreError: the directory holds something else, or a campaign with other settings.
    """
    if not (directory / SETTINGS).exists():
        return Store.create(directory, settings)
    if codec.digest(read_campaign_settings(directory)) != codec.digest(settings):
        raise StoreError(f"{directory}: holds a campaign with other settings; choose another one")
    return Store.resume(directory)


@contextlib.contextmanager
def open_executor(settings: CampaignSettings, choice: Choice) -> Iterator[Executor]:
    """An executor by name, open for a campaign; closed, with its workers, at the end."""
    executor = registry.build("executor", choice, where="campaign")
    try:
        executor.open(settings)
        yield executor
    finally:
        executor.close()


def local_workers(wanted: int | None) -> Choice:
    """Executor of ``wanted`` local processes; as many as this process may use cores if None."""
    return Choice("processes", {"workers": cores(wanted)})


def cores(wanted: int | None) -> int:
    """``wanted`` processes; as many as this one may use cores if None."""
    return wanted or len(os.sched_getaffinity(0))


def chosen_executor(name: str | None, workers: int | None) -> Choice:
    """Executor by name with ``workers`` if it has any; local processes if None.

    Raises:
        InputError: unknown name, or an extra that is not installed.
    """
    if name is None:
        return local_workers(workers)
    options = registry.load("executor", name, where="campaign").Options
    takes_workers = any(field.name == "workers" for field in dataclasses.fields(options))
    return Choice(name, local_workers(workers).options) if takes_workers else Choice(name)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """A campaign that has ended, for now."""

    campaign: Campaign
    progress: Progress
    ended: Ended
    wall_s: float


def run(
    store: Store,
    limits: Limits,
    executor: Choice,
    *,
    on_record: Callable[[TrialRecord, bool], None] = lambda record, is_new: None,
    on_told: Callable[[TrialRecord, Progress], None] = lambda record, progress: None,
) -> Result:
    """Run a campaign within limits (see :func:`~mrta_falsify.campaigns.runner.run_campaign`)."""
    began = time.monotonic()
    try:
        with open_executor(store.settings, executor) as opened:
            progress, ended = run_campaign(
                store, limits, opened, on_record=on_record, on_told=on_told
            )
    except KeyboardInterrupt:
        progress, ended = Progress(limits), "interrupted"
    return Result(
        campaign=store.campaign(),
        progress=progress,
        ended=ended,
        wall_s=time.monotonic() - began,
    )


def summary(result: Result) -> dict[str, Any]:
    """What ``campaign --format json`` prints."""
    progress = result.progress
    return {
        "budget": progress.limits.budget,
        "ran": progress.ran,
        "failed": progress.failed,
        "robust": progress.wanted if result.campaign.settings.trials.jittered else None,
        "rejected": progress.rejected,
        "errors": progress.errors,
        "first_failure_at": progress.first_failure,
        "modes": modes(result.campaign),
        "by_specification": progress.by_specification,
        "best_score": progress.best if progress.ran > progress.errors else None,
        "screening": screening_agreement(result.campaign),
        "probability": probability_of(
            result.campaign, stopped_early=bool(progress.limits.stop_after)
        ),
        "sim_hours": round(progress.sim_time / 3600.0, 4),
        "wall_s": round(result.wall_s, 3),
        "ended": result.ended,
        "directory": str(result.campaign.directory),
    }


def probability_of(campaign: Campaign, *, stopped_early: bool = False) -> dict[str, Any]:
    """Probability of a violation with its interval, or ``why_not``.

    Args:
        campaign: its trials.
        stopped_early: whether what was found decided how many trials there are.
    """
    estimating = is_estimating(campaign.settings)
    reason = why_no_probability(
        campaign.settings, stopped_early=stopped_early, is_estimating=estimating
    )
    if reason:
        return {"why_not": reason}
    if estimating:
        return dataclasses.asdict(estimated_probability(campaign))
    judged = [record for record in campaign.records if record.status == "ok"]
    errors = sum(record.status in ("crashed", "timeout") for record in campaign.records)
    failed = sum(record.failed for record in judged)
    return dataclasses.asdict(failure_probability(failed, len(judged), undecided=errors))


def modes(campaign: Campaign) -> list[dict[str, Any]]:
    """Failures grouped by signature, most frequent first: signature, count, ids.

    Knife edges come last among the ids, so that the first one is worth a look.
    """
    groups: dict[str, list[str]] = {}
    for record in sorted(campaign.records, key=lambda record: not record.wanted):
        if record.failed:
            groups.setdefault(record.signature, []).append(record.id)
    ordered = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    return [{"signature": name, "count": len(ids), "ids": ids} for name, ids in ordered]


def screening_agreement(campaign: Campaign) -> dict[str, int] | None:
    """How many failures of the quick engine physics confirmed; None without screening."""
    screened = [record.screening for record in campaign.records if record.screening is not None]
    if not campaign.settings.trials.screen:
        return None
    confirmed = sum(r.failed for r in campaign.records if r.screening is not None)
    return {"failed_in_screening": len(screened), "confirmed": confirmed}


# --- reading -------------------------------------------------------------------------------


def rows(campaign: Campaign, *, failed_only: bool = False) -> list[dict[str, Any]]:
    """One row per trial, as ``list --format json`` prints them."""
    chosen = [record for record in campaign.records if record.failed or not failed_only]
    return [
        {
            "id": record.id,
            "status": record.status,
            "score": record.score,
            "signature": record.signature,
            "failed": record.failed,
            "jittered": record.jittered.runs if record.jittered else 0,
            "jittered_failures": record.jittered.failed if record.jittered else 0,
            "violated": [verdict.spec for verdict in record.verdicts if verdict.violated],
            "layer": record.layer,
            "engine": record.engine,
            "sim_time_s": record.sim_time,
            "wall_s": record.wall_s,
            "attempts": record.attempts,
            "world_digest": record.world_digest,
            "trace_digest": record.trace_digest,
            "error": record.error,
        }
        for record in chosen
    ]


def stored_world(campaign: Campaign, record: TrialRecord) -> World:
    """World of a trial: its file if it was kept, sampled anew otherwise.

    Raises:
        StoreError: the trial has no world, or the file is not the world it was.
    """
    if record.status == "rejected":
        raise StoreError(f"trial {record.id} has no world: {record.error}")
    path = campaign.folder(record) / "world.json"
    if path.is_file():
        world = read_world(path)
    else:
        world = open_program(campaign.settings.trials).realise(record.candidate).world
    if record.world_digest and world.digest() != record.world_digest:
        raise StoreError(
            f"{path}: its digest is {world.digest()[:12]}, the record says "
            f"{record.world_digest[:12]}; the world is not the one that was run"
        )
    return world


def job_of(campaign: Campaign, record: TrialRecord) -> Job:
    """A stored trial as a job to be varied, stopped early.

    Raises:
        StoreError: as of :func:`stored_world`.
    """
    settings = campaign.settings.trials
    return Job(
        world=stored_world(campaign, record),
        config=stack_of(settings, record),
        specifications=specifications_of(settings),
        early_stop=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Replay:
    """Runs of one stored trial, compared with its record."""

    record: TrialRecord
    runs: tuple[Judged, ...]
    same_digest: int  #: runs with the recorded trace digest
    same_verdicts: int  #: runs that violate the same specifications at the same times
    same_machine: bool  #: versions and machine type are those of the record
    difference: Difference | None  #: of the first other run from the kept trace, if it is kept

    @property
    def identical(self) -> bool:
        """Whether every run is bit-equal to the record."""
        return self.same_digest == len(self.runs)


def replay(campaign: Campaign, record: TrialRecord, *, times: int = 1) -> Replay:
    """Run a stored trial again.

    Args:
        campaign: it belongs to.
        record: of the trial.
        times: how often.

    Raises:
        InputError: the trial has no world, or the campaign's files have changed.
    """
    world = stored_world(campaign, record)
    runs = tuple(rerun(campaign.settings.trials, record, world) for _ in range(times))
    others = [r.outcome.trace for r in runs if r.outcome.trace.digest != record.trace_digest]
    stored = campaign.folder(record) / "trace.zip"
    difference = None
    if others and stored.is_file():
        difference = first_difference(read_trace(stored), others[0])
    wanted = {v.spec: v.violated_at for v in record.verdicts if v.violated}
    violations = [{v.spec: v.violated_at for v in r.verdicts if v.violated} for r in runs]
    return Replay(
        record=record,
        runs=runs,
        same_digest=sum(r.outcome.trace.digest == record.trace_digest for r in runs),
        same_verdicts=sum(found == wanted for found in violations),
        same_machine=record.versions == versions(),
        difference=difference,
    )


def store_replay(campaign: Campaign, result: Replay) -> ReplayCheck:
    """Keep what replays have shown beside the trial, for the report."""
    folder = campaign.folder(result.record)
    app.make_directory(folder)
    check = ReplayCheck(
        runs=len(result.runs),
        identical=result.same_digest,
        same_verdicts=result.same_verdicts,
        same_machine=result.same_machine,
        first_difference=result.difference,
    )
    write_finding(folder, check)
    return check


def open_campaign(directory: Path) -> Campaign:
    """A campaign directory, for reading.

    Raises:
        StoreError: it is not one.
    """
    return read_campaign(directory)


def parse_params(texts: Sequence[str]) -> dict[str, Any]:
    """Scenic parameters of ``-p NAME=VALUE`` texts; numbers become numbers.

    Raises:
        InputError: a text is not of that form.
    """
    found: dict[str, Any] = {}
    for text in texts:
        name, separator, value = text.partition("=")
        if not separator or not name.strip().isidentifier():
            raise InputError(f"-p {text}: it must read NAME=VALUE")
        found[name.strip()] = _number_or_text(value)
    return found


def _number_or_text(text: str) -> Any:
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


def shown(record: TrialRecord) -> dict[str, Any]:
    """A record as ``show --format json`` prints it."""
    data: dict[str, Any] = app.finite(codec.encode(record))
    return {"id": record.id, "failed": record.failed, **data}
