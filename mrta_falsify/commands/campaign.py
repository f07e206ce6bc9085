"""Search a Scenic program for failures: begin a campaign, or resume one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mrta_falsify.campaigns.made_here import has_seal, refuse_links
from mrta_falsify.campaigns.rules import why_no_resume
from mrta_falsify.campaigns.runner import Ended, Progress, run_campaign, stored_progress
from mrta_falsify.campaigns.settings import (
    DEFAULT_LIMITS,
    DEFAULTS,
    MAX_TRIALS,
    CampaignSettings,
    Limits,
    Mode,
)
from mrta_falsify.campaigns.store import (
    SETTINGS,
    TRIALS,
    Campaign,
    Store,
    StoreError,
    read_campaign_settings,
)
from mrta_falsify.campaigns.trial_index import INDEXED, write_index
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.programs import Params
from mrta_falsify.commands.scene_preflight import ScenePreflight
from mrta_falsify.commands.stacks import Stack
from mrta_falsify.commands.trust import Trust, of_campaign, of_links, permit
from mrta_falsify.commands.workers import chosen_executor, count_cores, open_executor
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.interruption import propagate_interrupts
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.renamed import renamed_keywords
from mrta_falsify.lab import open_program

#: called when a record is durable, with whether it is new
OnRecord = Callable[[TrialRecord, bool], None]
#: called when the sampler knows a record, in number order
OnFeedback = Callable[[TrialRecord, Progress], None]
#: called with what the user should know
OnNote = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CampaignResult:
    """A campaign that has ended, for now."""

    campaign: Campaign
    progress: Progress
    ended: Ended | Literal["interrupted"]
    wall_s: float

    def __repr__(self) -> str:
        """Write it in one line."""
        return f"<CampaignResult of {self.campaign!r}, ended: {self.ended}>"


@renamed_keywords(on_told="on_feedback")
def campaign(
    scenario: Place,
    output: Place,
    *,
    budget: int | None = DEFAULT_LIMITS.budget,
    wall_clock: float = DEFAULT_LIMITS.wall_clock,
    stop_after: int = DEFAULT_LIMITS.stop_after,
    until_saturated: float = DEFAULT_LIMITS.until_saturated,
    sampler: Choice | str = DEFAULTS.sampler.name,
    seed: int = DEFAULTS.trials.seed,
    workers: int | None = None,
    executor: str | None = None,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    against: Stack | None = None,
    specs: str | Sequence[str] = (),
    then: str | Sequence[str] = (),
    params: Params = (),
    mode: Mode = DEFAULTS.trials.mode,
    screen: bool = DEFAULTS.trials.screen,
    jittered: int = DEFAULTS.trials.jittered,
    verify: int = DEFAULTS.trials.verify,
    confirm: Sequence[str] = (),
    with_shut_rooms: bool = DEFAULTS.trials.with_shut_rooms,
    window: int = DEFAULTS.window,
    tick_limit: float = DEFAULTS.trials.tick_limit,
    memory_limit: float = DEFAULTS.trials.memory_limit,
    time_limit: float = DEFAULTS.time_limit,
    on_record: OnRecord = lambda record, is_new: None,
    on_feedback: OnFeedback = lambda record, progress: None,
    on_note: OnNote = lambda text: None,
) -> CampaignResult:
    """Search a Scenic program for worlds in which the stack violates a specification.

    Args:
        scenario: shipped name or path of a Scenic program.
        output: directory of the campaign, empty or missing.
        budget: simulated candidates; None: as many as ``wall_clock`` allows.
        wall_clock: time [s] after which no trial is begun; 0: as long as it takes.
        stop_after: failures to stop at; 0 runs the whole budget.
        until_saturated: chance of a situation not seen yet to stop at; 0 runs the whole budget.
        sampler: registered name, or a choice with options.
        seed: of the campaign; same seed, same candidates.
        workers: processes; one per core if None. Changes no result.
        executor: registered name; local processes if None.
        stack: the stack under test, or its YAML file; the default stack if None.
        settings: ``--set`` texts applied to the stack.
        against: another stack: failures are looked for that it does not share. Engine and people
            are those of the stack under test.
        specs: names of specifications, or ``stl:FORMULA``; those of campaigns if empty.
        then: secondary specifications: they end no trial early, have no copies and
            do not count for ``stop_after``; deadlines and undone tasks if both are empty.
        params: Scenic's global parameters to override.
        mode: how scenes are accepted, ``repair`` or ``exact``.
        screen: kinematic engine first, physics only for what fails there.
        jittered: copies with small differences that are run of each failing world.
        verify: runs again of each failure of a foreign stack, nothing changed.
        confirm: engines that robust failures are run on as well, with copies.
        with_shut_rooms: simulate worlds, too, in which no robot fits to a room of a task.
        window: trials that may run before the sampler knows their results, and so at a time.
        tick_limit: CPU time for one tick [s], after which the stack hangs.
        memory_limit: resident memory that the stack may take up [GiB].
        time_limit: work and sleep of all processes of one trial [s].
        on_record: called when a record is durable, with whether it is new.
        on_feedback: called when the sampler knows a record, in number order.
        on_note: called with what the user should know.

    Raises:
        InputError: anything of it is wrong; a directory that holds something.
    """
    limits = Limits(
        budget=_or_clock(budget, wall_clock),
        wall_clock=wall_clock,
        stop_after=stop_after,
        until_saturated=until_saturated,
    )
    chosen = new_settings(
        scenario,
        output=output,
        stack=stack,
        settings=settings,
        against=against,
        specs=specs,
        then=then,
        params=params,
        sampler=sampler,
        seed=seed,
        mode=mode,
        screen=screen,
        jittered=jittered,
        verify=verify,
        confirm=confirm,
        with_shut_rooms=with_shut_rooms,
        window=window,
        tick_limit=tick_limit,
        memory_limit=memory_limit,
        time_limit=time_limit,
    )
    if not chosen.cube.dimensions:
        on_note(
            f"{scenario}: the program has no search dimension, so trials differ in their seeds "
            "only; draw a value at random to search it, as `with speed Range(0.5, 1.5)`"
        )
    place = chosen_executor(executor, workers)
    _note_idle_workers(chosen, executor, workers, on_note)
    with Store.create(Path(output), dataclasses.replace(chosen, budget=budget or 0)) as store:
        return run_store(
            store, limits, place, on_record=on_record, on_feedback=on_feedback, on_note=on_note
        )


@renamed_keywords(on_told="on_feedback")
def resume_campaign(
    directory: Place,
    *,
    budget: int | None = None,
    wall_clock: float = DEFAULT_LIMITS.wall_clock,
    stop_after: int = DEFAULT_LIMITS.stop_after,
    until_saturated: float = DEFAULT_LIMITS.until_saturated,
    time_limit: float | None = None,
    workers: int | None = None,
    executor: str | None = None,
    trust: Trust = False,
    on_record: OnRecord = lambda record, is_new: None,
    on_feedback: OnFeedback = lambda record, progress: None,
    on_note: OnNote = lambda text: None,
) -> CampaignResult:
    """Go on with a campaign where it stopped.

    Args:
        directory: of the campaign.
        budget: simulated candidates, those already stored included; the campaign's own if None.
        wall_clock: time [s] of this call after which no trial is begun; 0: as long as it takes.
        stop_after: failures to stop at; 0 runs the whole budget.
        until_saturated: chance of a situation not seen yet to stop at; 0 runs the whole budget.
        time_limit: of one trial [s], as in :func:`campaign`; the campaign's own if None.
        workers: processes; one per core if None.
        executor: registered name; local processes if None.
        trust: run what is not ours, though somebody else has made the campaign.
        on_record: called when a record is durable, with whether it is new.
        on_feedback: called when the sampler knows a record, in number order.
        on_note: called with what the user should know.

    Raises:
        InputError: not a campaign, of other rules, or its program or what is proposed has changed;
            nothing is written then.
        HarnessError: a trial was lost each time it was run.
    """
    place = chosen_executor(executor, workers)
    permit_resuming(Path(directory), trust)
    with Store.resume(Path(directory)) as store:
        if store.settings.trials.sources_digest:
            open_program(store.settings.trials)  # before anything is written
        if budget is None and not (wall_clock and not store.settings.budget):
            budget = _own_budget(store, on_note)
        limits = Limits(
            budget=_or_clock(budget, wall_clock),
            wall_clock=wall_clock,
            stop_after=stop_after,
            until_saturated=until_saturated,
        )
        store.keep(budget=budget or 0, time_limit=time_limit or store.settings.time_limit)
        return run_store(
            store, limits, place, on_record=on_record, on_feedback=on_feedback, on_note=on_note
        )


def _or_clock(budget: int | None, wall_clock: float) -> int:
    """Give the budget, or as good as none where the clock ends the campaign."""
    if budget is not None:
        return budget
    if not wall_clock:
        raise ConfigError("a campaign needs a budget, or a time after which it ends")
    return MAX_TRIALS


def _note_idle_workers(
    settings: CampaignSettings, executor: str | None, workers: int | None, on_note: OnNote
) -> None:
    """Say that some workers will have nothing to do."""
    count = count_cores(workers)
    if executor is None and count > settings.window:
        on_note(
            f"{count} workers, but no more trials than --window ({settings.window}) run at a time; "
            f"--window {count} of a new campaign lets all of them work"
        )


def _own_budget(store: Store, on_note: OnNote) -> int:
    """Find the budget to keep: the recorded one, else the trials run, else the default."""
    if store.settings.budget:
        on_note(f"budget {store.settings.budget}, as the campaign began; change it by --budget")
        return store.settings.budget
    ran = stored_progress(store, DEFAULT_LIMITS).ran
    kept = f"the {ran} trials it has run are kept" if ran else "the default is taken"
    on_note(
        f"{store.directory}: recorded no budget (the clock ended it, or an older version wrote "
        f"it); {kept} as budget {ran or DEFAULT_LIMITS.budget}; give --budget for another one"
    )
    return ran or DEFAULT_LIMITS.budget


def open_store(directory: Path, settings: CampaignSettings) -> Store:
    """Begin a campaign with ``settings``, or open the one that is there.

    Raises:
        StoreError: the directory holds something else, or a campaign with other settings.
    """
    if not (directory / SETTINGS).exists():
        return Store.create(directory, settings)
    there = dataclasses.replace(
        read_campaign_settings(directory), budget=settings.budget, time_limit=settings.time_limit
    )
    if codec.digest(there) != codec.digest(settings):
        raise StoreError(f"{directory}: holds a campaign with other settings; choose another one")
    refuse_links(directory, directory / TRIALS)
    return Store.resume(directory)


def permit_resuming(directory: Path, trust: Trust) -> None:
    """Ask whether all that a campaign names may run.

    Raises:
        StoreError: not a campaign, of other rules, or nothing says which program it began with.
        NeedsOption: it may not.
    """
    is_own = has_seal(directory)
    if not is_own:  # its trials may be many
        permit(directory, of_links(directory, directory / TRIALS), trust)
    settings = read_campaign_settings(directory)
    reason = why_no_resume(settings.rules)
    if reason:
        raise StoreError(f"{directory}: {reason}")
    permit(directory, of_campaign(settings), trust)
    if not settings.trials.sources_digest and not is_own:
        raise StoreError(
            f"{directory / SETTINGS}: has no digest of its program, so "
            f"{settings.trials.scenario} cannot be compared with the program that the campaign "
            "began with; begin a new campaign"
        )


def _here(store: Store) -> CampaignSettings:
    """Let trials write into the folder where the campaign lies now, whatever its file says."""
    trials = store.settings.trials
    folder = str(store.directory.resolve()) if trials.directory else ""
    return dataclasses.replace(store.settings, trials=dataclasses.replace(trials, directory=folder))


def run_store(
    store: Store,
    limits: Limits,
    executor: Choice,
    *,
    on_record: OnRecord = lambda record, is_new: None,
    on_feedback: OnFeedback = lambda record, progress: None,
    on_note: OnNote = lambda text: None,
) -> CampaignResult:
    """Run an open campaign within limits, as :func:`~mrta_falsify.campaigns.runner.run_campaign`.

    Ctrl-C ends it as ``interrupted``, with counts over all that is stored.
    """
    began = time.monotonic()
    ended: Ended | Literal["interrupted"]
    try:
        with propagate_interrupts(), open_executor(_here(store), executor) as opened:
            progress, ended = run_campaign(
                store,
                limits,
                opened,
                on_record=on_record,
                on_feedback=on_feedback,
                on_note=on_note,
                preflight=ScenePreflight(store.settings.trials),
            )
    except KeyboardInterrupt:
        progress, ended = stored_progress(store, limits), "interrupted"
    campaign = store.campaign()
    if len(campaign.records) >= INDEXED:
        from mrta_falsify.commands.report.build import index_of  # noqa: PLC0415 - loads slowly

        store.check()  # the index is of the log as it was read
        write_index(store.directory, index_of(campaign))
    return CampaignResult(
        campaign=campaign,
        progress=progress,
        ended=ended,
        wall_s=time.monotonic() - began,
    )
