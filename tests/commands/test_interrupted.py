"""Ctrl-C inside an episode: no command takes what was seen until then for an answer."""

from __future__ import annotations

import dataclasses
import itertools
import os

import pytest

from mrta_falsify.analysis.explain.explaining import explain
from mrta_falsify.analysis.minimize import minimising, reruns
from mrta_falsify.analysis.minimize.minimising import minimize
from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Store, read_campaign
from mrta_falsify.commands import campaign as campaigns
from mrta_falsify.commands import corpus
from mrta_falsify.commands.campaign import run_store
from mrta_falsify.commands.campaign_summary import NoProbability, summarise_campaign
from mrta_falsify.commands.replay import replay
from mrta_falsify.commands.run import run
from mrta_falsify.commands.workers import open_executor
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.findings import Explanation, Minimisation, ReplayCheck
from mrta_falsify.core.interruption import Interrupted
from mrta_falsify.testing.records import changed
from mrta_falsify.trial import on_kinematic_engine
from simulator_interface.episode import Episode
from simulator_interface.simulate import simulate
from tests.campaigns.standin import settings
from tests.reports.planted import BROKEN

SOON = 40  # ticks into an episode


@pytest.fixture
def interrupts(monkeypatch):
    """Lets Ctrl-C come a little after the beginning of the n-th episode from now on."""
    frames_of = Episode.frames
    counter = itertools.count(1)
    at: list[int] = []

    def frames(self):
        number = next(counter)
        for tick, frame in enumerate(frames_of(self)):
            if number in at and tick == SOON:
                raise KeyboardInterrupt
            yield frame

    monkeypatch.setattr(Episode, "frames", frames)

    def set_at(*numbers: int) -> None:
        nonlocal counter
        counter = itertools.count(1)
        at[:] = numbers

    return set_at


@pytest.fixture
def few_votes(monkeypatch):
    """Lets two perturbed runs vote on a smallest world instead of ten."""
    monkeypatch.setattr(reruns, "PERTURBED", 2)


def test_an_interrupted_episode_has_no_outcome(stalled, interrupts):
    world, _ = stalled
    interrupts(1)
    with pytest.raises(KeyboardInterrupt):
        simulate(world, BROKEN)


def test_an_interrupted_run_says_how_far_it_came_and_writes_nothing(stalled, interrupts, tmp_path):
    world, _ = stalled
    interrupts(1)
    with pytest.raises(Interrupted, match=r"came to \d+ s of at most .* has no verdict"):
        run(world, BROKEN, output=tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_an_interrupted_run_leaves_the_files_of_an_earlier_one_as_they_were(
    stalled, tmp_path, monkeypatch
):
    from reports import page

    world, _ = stalled
    short = dataclasses.replace(world, horizon=2.0)
    run(short, BROKEN, output=tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def interrupt(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(page, "write_page", interrupt)  # all other files are written by then
    with pytest.raises(Interrupted):
        run(dataclasses.replace(short, horizon=3.0), BROKEN, output=tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.usefixtures("in_process")
@pytest.mark.slow
def test_corpus_does_not_call_an_interrupted_failure_fixed(campaign, interrupts):
    told = []
    interrupts(2)
    with pytest.raises(Interrupted, match="kept: 1 finished run"):
        corpus.recheck(campaign, jittered=1, on_done=told.append)
    assert told == []
    interrupts(2)  # the second run from now on would be one too many
    (row,) = corpus.recheck(campaign, jittered=1)
    assert row.fate == "still failing"
    assert not (campaign.directory / corpus.JOURNAL_NAME).exists()


@pytest.mark.usefixtures("in_process")
@pytest.mark.slow
def test_corpus_on_another_stack_takes_nothing_from_the_journal(campaign, interrupts):
    interrupts(2)
    with pytest.raises(Interrupted):
        corpus.recheck(campaign, jittered=1)
    interrupts()
    (row,) = corpus.recheck(campaign, config=on_kinematic_engine(StackConfig()), jittered=0)
    assert row.fate == "fixed"


@pytest.mark.slow
def test_replay_stores_nothing_until_all_runs_are_finished(campaign, interrupts):
    folder = campaign.directory / "trials" / "0000"
    interrupts(3)
    with pytest.raises(Interrupted, match="kept: 2 finished runs"):
        replay(campaign.directory, 0, verify=3)
    assert read_finding(folder, ReplayCheck) is None
    interrupts(2)  # one run is missing
    result = replay(campaign.directory, 0, verify=3)
    assert (result.same_digest, len(result.runs)) == (3, 3)
    check = read_finding(folder, ReplayCheck)
    assert (check.identical, check.runs) == (3, 3)
    interrupts(1)
    with pytest.raises(Interrupted, match="kept: nothing"):  # a new call runs anew
        replay(campaign.directory, 0, verify=1)


def test_explain_of_an_interrupted_run_does_not_say_that_it_violates_nothing(campaign, interrupts):
    interrupts(1)
    with pytest.raises(Interrupted, match="explain 0000 has no result"):
        explain(campaign, campaign.record("0"), max_runs=3)


@pytest.mark.long
def test_explain_goes_on_to_the_same_explanation(campaign, interrupts):
    record, folder = campaign.record("0"), campaign.directory / "trials" / "0000"
    peace = explain(campaign, record, max_runs=4)
    (folder / "explain.json").unlink()
    done = []

    def count(runs, total):
        done.append(runs)
        if runs == 3:  # the first is the failure itself, which is run each time
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="kept: 2 finished runs"):
        explain(campaign, record, max_runs=4, on_done=count)
    assert read_finding(folder, Explanation) is None
    assert explain(campaign, record, max_runs=4) == peace
    assert read_finding(folder, Explanation) == peace


@pytest.mark.long
@pytest.mark.usefixtures("few_votes")
def test_minimize_keeps_no_answer_of_an_interrupted_run(campaign, interrupts, tmp_path):
    record, folder = campaign.record("0"), campaign.directory / "trials" / "0000"
    interrupts(3)
    with pytest.raises(Interrupted, match="kept: 1 finished run"):
        minimize(campaign, record, max_runs=4)
    assert read_finding(folder, Minimisation) is None
    assert not (folder / minimising.WORLD).exists()
    interrupts()
    found = minimize(campaign, record, max_runs=4)
    for path in folder.glob("minimize.*"):
        path.unlink()
    assert minimize(campaign, record, max_runs=4) == found


@pytest.mark.long
@pytest.mark.usefixtures("few_votes")
def test_minimize_does_not_believe_the_cache_of_an_older_version(campaign):
    record, folder = campaign.record("0"), campaign.directory / "trials" / "0000"
    found = minimize(campaign, record, max_runs=3)
    path = folder / minimising.JOURNAL_NAME
    keys = [row["run"] for row in read_rows(path)]
    path.unlink()
    for key in keys:  # as the version before wrote that a run was interrupted
        append_row(path, {"run": key, "ran": True, "course": None})
    assert minimize(campaign, record, max_runs=3) == found


# --- campaigns -------------------------------------------------------------------------------


def _interrupt_after(count: int):
    told = itertools.count(1)

    def on_record(record, is_new):
        if is_new and next(told) == count:
            raise KeyboardInterrupt

    return on_record


def test_a_campaign_interrupted_twice_counts_what_is_stored(tmp_path, monkeypatch):
    with Store.create(tmp_path / "c", settings()) as store:
        first = run_store(store, Limits(budget=8), Choice("serial"), on_record=_interrupt_after(5))
    assert (first.ended, first.progress.ran) == ("interrupted", 5)

    def interrupt(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(campaigns, "open_executor", interrupt)
    with Store.resume(tmp_path / "c") as store:
        second = run_store(store, Limits(budget=8), Choice("serial"))
    assert (second.ended, second.progress.ran) == ("interrupted", 5)
    assert second.progress.failed == first.progress.failed
    assert isinstance(summarise_campaign(second).probability, NoProbability)


def test_an_interruption_leaves_whole_lines_and_lets_go_of_the_lock(tmp_path, monkeypatch):
    real = os.fsync

    def interrupt(handle):
        real(handle)
        raise KeyboardInterrupt

    with Store.create(tmp_path / "c", settings()) as store:
        run_store(store, Limits(budget=3), Choice("serial"))
        monkeypatch.setattr(os, "fsync", interrupt)
        result = run_store(store, Limits(budget=4), Choice("serial"))
        monkeypatch.undo()
    assert result.ended == "interrupted"
    assert len(read_campaign(tmp_path / "c").records) == 3
    with Store.resume(tmp_path / "c") as store:
        result = run_store(store, Limits(budget=4), Choice("serial"))
    assert result.progress.ran == 4


def test_a_record_of_an_interrupted_run_by_an_older_version_is_run_again(tmp_path):
    with Store.create(tmp_path / "c", settings()) as store:
        run_store(store, Limits(budget=3), Choice("serial"))
        whole = store.finished[1]
    with Store.create(tmp_path / "old", settings()) as store:
        store.add(changed(whole, ended="interrupted"))
    assert read_campaign(tmp_path / "old").records == ()
    with Store.resume(tmp_path / "old") as store:
        result = run_store(store, Limits(budget=3), Choice("serial"))
        assert store.finished[1].ended == whole.ended
    assert result.progress.ran == 3
    assert len(read_campaign(tmp_path / "old").records) == 3


def test_ctrl_c_passes_through_the_search_loop(tmp_path):
    chosen = settings()
    with (
        Store.create(tmp_path / "c", chosen) as store,
        open_executor(chosen, Choice("serial")) as executor,
        pytest.raises(KeyboardInterrupt),
    ):
        run_campaign(store, Limits(budget=4), executor, on_record=_interrupt_after(2))
    assert len(read_campaign(tmp_path / "c").records) == 2
