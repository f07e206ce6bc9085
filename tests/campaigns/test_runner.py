from __future__ import annotations

import dataclasses
import json
import os
import signal
import time
from pathlib import Path

import pytest

from mrta_falsify.campaigns.executors import ProcessExecutor, SerialExecutor
from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.runner import feedback_of, run_campaign, sampler_options
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import RECORDS, Store, StoreError, read_campaign
from mrta_falsify.commands.campaign import resume_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.testing.records import changed
from tests.campaigns.logs import files_of_trials, log_without_times
from tests.campaigns.standin import settings
from tests.survival.kept_trials import kept_settings


def _run(store, *, workers=0, **limits):
    made = (
        ProcessExecutor(ProcessExecutor.Options(workers=workers))
        if workers
        else SerialExecutor(SerialExecutor.Options())
    )
    try:
        made.open(store.settings)
        return run_campaign(store, Limits(**limits), made)
    finally:
        made.close()


def _records(directory):
    return [codec.encode(record) for record in read_campaign(directory).records]


def test_the_budget_counts_simulated_candidates_not_rejected_ones(tmp_path):
    with Store.create(tmp_path, settings(reject_above=0.5)) as store:
        progress, ended = _run(store, budget=20)
    assert ended == "budget"
    assert progress.ran == 20
    assert progress.rejected > 0
    assert len(_records(tmp_path)) == progress.told == 20 + progress.rejected


@pytest.mark.parametrize(
    "workers",
    [(2,), *(pytest.param(counts, marks=pytest.mark.long) for counts in ((1,), (4,), (2, 0, 4)))],
)
def test_any_number_of_workers_gives_the_same_log_and_files(tmp_path, workers):
    """On 1, 2 and 4 workers, and begun on two, gone on with in this process, ended on four."""
    for name, each in (("serial", (0,)), ("other", workers)):
        chosen = kept_settings(str(tmp_path / name), reject_above=0.8)
        Store.create(tmp_path / name, chosen).close()
        for part, count in enumerate(each, start=1):
            with Store.resume(tmp_path / name) as store:
                _run(store, workers=count, budget=25 * part // len(each))
    log = log_without_times(tmp_path / "other")
    assert log == log_without_times(tmp_path / "serial")
    files = files_of_trials(tmp_path / "other")
    assert files == files_of_trials(tmp_path / "serial")
    assert len(files) == 2 * sum("result" in row for row in log)


def test_a_campaign_in_pieces_equals_one_that_ran_through(tmp_path):
    chosen = settings(reject_above=0.7)
    with Store.create(tmp_path / "through", chosen) as store:
        whole, _ = _run(store, budget=30)
    Store.create(tmp_path / "pieces", chosen).close()
    for budget in (1, 7, 8, 30):
        with Store.resume(tmp_path / "pieces") as store:
            last, _ = _run(store, budget=budget)
    assert _records(tmp_path / "pieces") == _records(tmp_path / "through")
    assert last == dataclasses.replace(whole, limits=last.limits)


def test_it_stops_after_the_wanted_number_of_failures(tmp_path):
    with Store.create(tmp_path, settings()) as store:
        progress, ended = _run(store, budget=500, stop_after=2)
    assert ended == "stop-after"
    assert progress.failed == 2
    assert progress.first_failure is not None
    assert progress.first_failure < progress.ran < 500
    assert progress.by_specification == {"no_deadlock": 2}


def test_where_copies_are_asked_for_only_robust_failures_are_wanted(tmp_path):
    told = []
    with Store.create(tmp_path, settings(jittered=8, dimensions=2)) as store:
        progress, ended = _run(store, budget=500, stop_after=4)
        for record in store.campaign().records[: progress.told]:
            told.append((record, feedback_of(record, store.settings.cube)))
    assert ended == "stop-after"
    assert progress.robust == 4 < progress.failed
    for record, feedback in told:
        assert record.failed == (record.vote is not None)
        most = record.failed and record.vote.failed > 4
        assert record.is_robust == most
        assert feedback.failed == record.failed
        assert (feedback.signature == record.signature) == (record.is_robust or not record.failed)


def test_samplers_that_can_tell_knife_edges_know_whether_they_are_wanted():
    for name, expected in (("auto", True), ("random", None)):
        chosen = settings(sampler=Choice(name), jittered=2)
        assert sampler_options(chosen).get("robust") is expected
        assert not sampler_options(settings(sampler=Choice(name))).get("robust")
    own = settings(sampler=Choice("auto", {"robust": False}), jittered=2)
    assert sampler_options(own)["robust"] is False


# --- workers that die at their start --------------------------------------------------------


@pytest.mark.parametrize("starts", ["k", "kkekk"])
def test_a_worker_that_dies_before_it_is_ready_is_started_again(tmp_path, starts):
    begun = tmp_path / "begun"
    with Store.create(tmp_path / "c", settings(starts=starts, begun=str(begun))) as store:
        _run(store, workers=1, budget=3)
    assert len(begun.read_text()) == len(starts) + 1
    with Store.create(tmp_path / "undisturbed", settings()) as store:
        _run(store, budget=3)
    found, undisturbed = (
        [{**record, "candidate": None} for record in _records(tmp_path / name)]
        for name in ("c", "undisturbed")
    )
    assert found == undisturbed


@pytest.mark.parametrize(
    ("starts", "until", "words"),
    [("kkk", 3, "it ends by k"), ("keee", 4, "RuntimeError: on demand: e"), ("keke", 4, ": e")],
)
def test_the_same_end_three_times_in_a_row_ends_the_campaign_with_its_last_words(
    tmp_path, monkeypatch, starts, until, words
):
    monkeypatch.setattr("mrta_falsify.process.pool.MAX_STARTS", 4)  # of any end
    begun = tmp_path / "begun"
    with (
        Store.create(tmp_path / "c", settings(starts=starts, begun=str(begun))) as store,
        pytest.raises(HarnessError, match="before it was ready") as ended,
    ):
        _run(store, workers=1, budget=3)
    assert len(begun.read_text()) == until
    assert str(ended.value).endswith(words)


def test_workers_that_are_all_killed_at_their_start_are_started_again(tmp_path, monkeypatch):
    killed = []

    def submit(job):
        executor.pool.submit(job["number"], job)
        if len(killed) < 4:
            killed.append(executor.pool.workers[-1].child.number)
            os.kill(killed[-1], signal.SIGKILL)

    with Store.create(tmp_path, settings()) as store:
        executor = ProcessExecutor(ProcessExecutor.Options(workers=4))
        monkeypatch.setattr(executor, "submit", submit)
        try:
            executor.open(store.settings)
            progress, ended = run_campaign(store, Limits(budget=8), executor)
        finally:
            executor.close()
    assert (progress.ran, ended) == (8, "budget")
    assert len(set(killed)) == 4


def test_what_a_worker_says_at_its_start_is_heard_once_it_is_ready(tmp_path, capfd):
    words = "import sys; print('a warning', file=sys.stderr)"
    (tmp_path / "sitecustomize.py").write_text(words)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
        with Store.create(tmp_path / "c", settings()) as store:
            _run(store, workers=1, budget=1)
    assert capfd.readouterr().err.count("a warning") == 1


# --- lost trials --------------------------------------------------------------------------


def _undisturbed(directory, **limits):
    with Store.create(directory, settings()) as store:
        _run(store, **limits)
    return _records(directory)


def _noted(store, executor, **limits):
    notes = []
    try:
        executor.open(store.settings)
        run_campaign(store, Limits(**limits), executor, on_note=notes.append)
    finally:
        executor.close()
    return notes


@pytest.mark.parametrize(
    ("fault", "times", "workers", "why"),
    [
        ("raise", 2, 0, "RuntimeError: on demand"),
        ("unfit", 2, 0, "the stack cannot be started"),
        ("raise", 1, 1, "RuntimeError: on demand"),
        ("unfit", 1, 1, "the stack cannot be started"),
        ("crash", 1, 1, "worker ended by exit code 7"),
        ("hang", 1, 1, "killed after 0.5 s of work and sleep"),
    ],
)
def test_a_trial_that_was_lost_is_run_again_and_the_campaign_is_the_same(
    tmp_path, fault, times, workers, why
):
    lost = {fault: [3], "tries": str(tmp_path / "tries"), "times": times, "time_limit": 0.5}
    with Store.create(tmp_path / "c", settings(**lost)) as store:
        made = (
            ProcessExecutor(ProcessExecutor.Options(workers=workers))
            if workers
            else SerialExecutor(SerialExecutor.Options())
        )
        notes = _noted(store, made, budget=6)
    assert notes == [f"trial 0003 was lost ({why}); it is run again"] * times
    assert _records(tmp_path / "c") == _undisturbed(tmp_path / "peace", budget=6)


def test_a_worker_that_is_stopped_for_longer_than_the_limit_is_not_lost():
    made = ProcessExecutor(ProcessExecutor.Options(workers=1))
    try:
        made.open(settings(sleep=0.2, time_limit=0.4))
        made.submit({"number": 0, "u": [0.5]})
        (worker,) = made.pool.workers
        while worker.job is None:
            made.collect(0.05)
        os.kill(worker.child.number, signal.SIGSTOP)
        until = time.monotonic() + 1.2
        while time.monotonic() < until:
            assert made.collect(0.05) == ()
        os.kill(worker.child.number, signal.SIGCONT)
        done = ()
        while not done:
            done = made.collect(0.05)
    finally:
        made.close()
    assert [(one.number, one.fate) for one in done] == [(0, "ok")]


class Losing(SerialExecutor):
    """Loses the first jobs of trial 3 in one way or another."""

    def __init__(self, fate, times):
        super().__init__(SerialExecutor.Options())
        self.fate, self.left, self.ran = fate, times, []

    def collect(self, timeout):
        (finished,) = super().collect(timeout)
        self.ran.append(finished.number)
        if finished.number != 3 or not self.left:
            return (finished,)
        self.left -= 1
        error = "Traceback: ...\n  where it was\nOSError: no room\n"
        return (dataclasses.replace(finished, fate=self.fate, record=None, error=error),)


@pytest.mark.parametrize(
    ("fate", "kind", "hint"),
    [
        ("crashed", HarnessError, r"continue with: mrta-falsify campaign --resume \S+"),
        ("refused", InputError, r"continue with: mrta-falsify campaign --resume \S+"),
        ("timeout", HarnessError, r"give it more than 60 s: .* --resume \S+ --time-limit 120"),
    ],
)
def test_a_trial_that_is_lost_three_times_stops_the_campaign_and_a_later_call_runs_it(
    tmp_path, fate, kind, hint
):
    losing = Losing(fate, 3)
    with Store.create(tmp_path / "c", settings()) as store:
        text = r"^trial 0003 was lost 3 times \(OSError: no room\); nothing of it is stored; "
        with pytest.raises(kind, match=text + hint) as stopped:
            _noted(store, losing, budget=12)
        assert losing.ran.count(3) == 3
        assert 3 not in store.finished
        assert {record.status for record in store.finished.values()} == {"ok"}
        if kind is HarnessError:
            assert any("where it was" in note for note in stopped.value.__notes__)
    with Store.resume(tmp_path / "c") as store:
        _run(store, budget=12)
    assert _records(tmp_path / "c") == _undisturbed(tmp_path / "peace", budget=12)


def test_no_sampler_is_told_of_a_trial_that_was_lost(tmp_path):
    told = []
    with Store.create(tmp_path, settings()) as store:
        losing = Losing("crashed", 2)
        losing.open(store.settings)
        run_campaign(
            store, Limits(budget=6), losing, on_feedback=lambda record, counts: told.append(record)
        )
    assert [(record.number, record.status) for record in told] == [(n, "ok") for n in range(6)]


def test_errors_that_an_older_version_stored_stay_and_are_told_as_rejected(tmp_path):
    with Store.create(tmp_path, settings()) as store:
        _run(store, budget=6)
        whole = dict(store.finished)
    old = [
        changed(whole[n], verdicts=(), score=0.0, status=status)
        for n, status in ((1, "error"), (2, "timeout"))
    ]
    (tmp_path / RECORDS).unlink()
    with Store.resume(tmp_path) as store:
        for record in old:
            store.add(record)
        progress, ended = _run(store, budget=6)
    assert (ended, progress.ran, progress.errors) == ("budget", 6, 2)
    assert [record.status for record in read_campaign(tmp_path).records] == [
        "ok", "crashed", "timeout", "ok", "ok", "ok",
    ]  # fmt: skip
    assert {feedback_of(record, settings().cube).fate for record in old} == {"rejected"}


def test_a_scenario_that_workers_refuse_is_bad_input(tmp_path):
    with Store.create(tmp_path, settings(refuse=True)) as store:
        with pytest.raises(InputError, match=r"standin.scenic:3: refused"):
            _run(store, workers=1, budget=5)
        with pytest.raises(InputError, match="refused"):
            _run(store, budget=5)


def test_a_target_that_breaks_is_the_harness_at_fault(tmp_path):
    broken = dataclasses.replace(settings(), target="tests.campaigns.standin:no_such_function")
    with Store.create(tmp_path, broken) as store, pytest.raises(HarnessError, match="no_such"):
        _run(store, workers=1, budget=5)


def test_a_scenario_that_gives_no_scene_ends_with_the_reason(tmp_path):
    expected = pytest.raises(
        InputError, match=r"the last 30 proposals gave no valid scene.*no scene"
    )
    with Store.create(tmp_path, settings(reject_above=-1.0)) as store, expected:
        _run(store, budget=5, rejected_in_a_row=30)


def test_records_of_another_sampler_are_not_gone_on_with(tmp_path):
    with Store.create(tmp_path / "a", settings(seed=1)) as store:
        _run(store, budget=5)
    Store.create(tmp_path / "b", settings(seed=2)).close()
    (tmp_path / "b" / RECORDS).write_bytes((tmp_path / "a" / RECORDS).read_bytes())
    with (
        Store.resume(tmp_path / "b") as store,
        pytest.raises(StoreError, match=r"another point.* in another directory, or delete"),
    ):
        _run(store, budget=5)


def _bytes_of(directory: Path) -> dict[str, bytes]:
    return {str(p.relative_to(directory)): p.read_bytes() for p in directory.rglob("*.*")} | {
        "lock": (directory / "lock").read_bytes()
    }


def test_what_cannot_go_on_is_left_as_it_is(tmp_path):
    """Neither a gap in the log, which would be run first, nor a new budget, nor a torn line."""
    with Store.create(tmp_path / "a", settings(seed=1)) as store:
        _run(store, budget=8)
    lines = (tmp_path / "a" / RECORDS).read_bytes().splitlines(keepends=True)
    with Store.create(tmp_path / "b", settings(seed=2)) as store:
        _run(store, budget=5)
    log = tmp_path / "b" / RECORDS
    own = sorted(log.read_bytes().splitlines(keepends=True), key=_number)
    log.write_bytes(
        b"".join([*own[:3], *(one for one in lines if _number(one) in (4, 5))]) + b"torn"
    )
    before = _bytes_of(tmp_path / "b")
    with Store.resume(tmp_path / "b") as store:
        store.keep(budget=99, time_limit=store.settings.time_limit)
        with pytest.raises(StoreError, match="trial 0004 was proposed at another point"):
            _run(store, budget=99)
    assert _bytes_of(tmp_path / "b") == before


def _number(line: bytes) -> int:
    return int(json.loads(line.partition(b"\t")[2])["candidate"]["number"])


def test_a_gap_in_the_log_is_filled(tmp_path):
    with Store.create(tmp_path / "a", settings()) as store:
        _run(store, budget=12)
        whole = store.finished
    lines = (tmp_path / "a" / RECORDS).read_bytes().splitlines(keepends=True)
    kept = [line for line in lines if _number(line) not in (2, 4, 11)]
    (tmp_path / "a" / RECORDS).write_bytes(b"".join(kept))
    with Store.resume(tmp_path / "a") as store:
        _run(store, budget=12)
        assert store.finished.keys() == whole.keys()


@pytest.mark.parametrize(
    ("rules", "complaint"),
    [
        (1, r"rules 1, .* the last commit that can is 73399d2"),
        (2, r"rules 2, .* the last commit that can is 6271a96"),
        (RULES + 1, "a newer version"),
    ],
)
def test_a_campaign_of_other_rules_does_not_go_on_and_is_left_as_it_is(tmp_path, rules, complaint):
    stored = dataclasses.replace(settings(), rules=rules)
    with Store.create(tmp_path / "c", stored) as store:
        _run(store, budget=5)
    with (tmp_path / "c" / RECORDS).open("ab") as log:
        log.write(b"torn")
    before = _bytes_of(tmp_path / "c")
    with pytest.raises(StoreError, match=complaint):
        resume_campaign(tmp_path / "c", budget=99)
    assert _bytes_of(tmp_path / "c") == before
    assert len(read_campaign(tmp_path / "c").records) >= 5


def test_an_unknown_sampler_is_refused(tmp_path):
    expected = pytest.raises(InputError, match="did you mean 'random'")
    with Store.create(tmp_path, settings(sampler=Choice("randm"))) as store, expected:
        _run(store, budget=5)
