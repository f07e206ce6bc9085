from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from mrta_falsify.campaigns.executors import ProcessExecutor, SerialExecutor
from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.campaigns.runner import feedback_of, run_campaign, sampler_options
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import RECORDS, Store, StoreError, read_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import HarnessError, InputError
from mrta_falsify.verbs.campaign import resume_campaign
from tests.campaigns.standin import settings


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


def test_any_number_of_workers_gives_the_same_campaign(tmp_path):
    for workers in (0, 1, 3):
        with Store.create(tmp_path / str(workers), settings(reject_above=0.8)) as store:
            _run(store, workers=workers, budget=25)
    assert _records(tmp_path / "0") == _records(tmp_path / "1") == _records(tmp_path / "3")


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
    assert progress.wanted == 4 < progress.failed
    for record, feedback in told:
        assert record.failed == (record.jittered is not None)
        most = record.failed and record.jittered.failed > 4
        assert record.wanted == most
        assert feedback.failed == record.failed
        assert (feedback.signature == record.signature) == (record.wanted or not record.failed)


def test_samplers_that_can_tell_knife_edges_know_whether_they_are_wanted():
    for name, expected in (("auto", True), ("surrogate", True), ("random", None)):
        chosen = settings(sampler=Choice(name), jittered=2)
        assert sampler_options(chosen).get("robust") is expected
        assert not sampler_options(settings(sampler=Choice(name))).get("robust")
    own = settings(sampler=Choice("auto", {"robust": False}), jittered=2)
    assert sampler_options(own)["robust"] is False


@pytest.mark.parametrize("fault", ["crash", "raise"])
def test_a_crash_costs_one_trial_and_is_an_error_not_a_failure(tmp_path, fault):
    with Store.create(tmp_path, settings(**{fault: [3]})) as store:
        progress, _ = _run(store, workers=2, budget=12)
    records = read_campaign(tmp_path).records
    assert [record.number for record in records if record.status == "crashed"] == [3]
    assert not records[3].failed
    assert records[3].error
    assert progress.errors == 1
    assert progress.ran == 12


def test_a_call_whose_first_trials_are_all_errors_stops_and_a_later_one_goes_on(tmp_path):
    with Store.create(tmp_path, settings(**{"raise": list(range(8))})) as store:
        progress, ended = _run(store, workers=2, budget=30)
        assert (ended, progress.ran, progress.errors) == ("errors", 5, 5)
        progress, ended = _run(store, workers=2, budget=30)
    assert (ended, progress.ran, progress.errors) == ("budget", 30, 8)


def test_a_hang_is_killed_and_costs_one_trial(tmp_path):
    with Store.create(tmp_path, settings(hang=[1], time_limit=1.0)) as store:
        _run(store, workers=2, budget=5)
    records = read_campaign(tmp_path).records
    assert [record.status for record in records] == ["ok", "timeout", "ok", "ok", "ok"]
    assert "killed after 1 s" in records[1].error


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
    expected = pytest.raises(InputError, match=r"the last 30 proposals gave no scene.*no scene")
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
        store.keep_budget(99)
        with pytest.raises(StoreError, match="trial 0004 was asked for at another point"):
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
    [(1, r"rules 1, .* the last commit that can is 73399d2"), (RULES + 1, "a newer version")],
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
