"""What the studies of experiments/reports count, and what the gallery says."""

from __future__ import annotations

import dataclasses

import pytest

from experiments.reports import minimising
from experiments.reports.stored_failures import append_row, parse_part, rows_of, stored_failures
from mrta_falsify.testing.records import trial_record
from mrta_falsify.campaigns.store import Store
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import wait_account
from mrta_falsify.trial import Job
from tests.campaigns.standin import settings
from tests.conftest import scripted_trace
from tests.reports.planted import planted_campaign
from tools.gallery_pictures import Seen, write_picture

LATE = Verdict(spec="deadlines", robustness=-1.0, violated=True, violated_at=9.0, who=("task0",))
ROW = {
    "case": "a/0001",
    "campaign": "a",
    "trial": "0001",
    "scenario": "burst",
    "defects": ["same_room_twice_stalls"],
    "engine": "kinematic",
    "signature": "no_deadlock/1:stalled",
    "before": {"robots": 4, "tasks": 9, "humans": 0, "furniture": 200, "events": 0},
    "after": {"robots": 1, "tasks": 2, "humans": 0, "furniture": 0, "events": 0},
    "horizon_s": 60.0,
    "cycle": 1,
    "waited_for": 1,
    "share_removed": 0.98,
    "runs": 12,
    "finished": True,
    "verified": True,
    "kept": True,
    "spare": [],
    "program": "identical",
    "cpu_s": 9.0,
    "check_cpu_s": 2.0,
}


@pytest.fixture
def campaigns(tmp_path, make_record):
    """Two campaigns: four failures of one mode and one of another; one of the first mode."""
    for name, signatures in (("one", "aaaba"), ("two", "a ")):
        with Store.create(tmp_path / "deep" / name, settings()) as store:
            for number, signature in enumerate(signatures):
                store.add(make_record(number, signature.strip()))
    return tmp_path


@pytest.fixture
def make_record():
    def make(number: int, signature: str) -> TrialRecord:
        return trial_record(
            number, [0.0], signature=signature, verdicts=(LATE,) if signature else ()
        )

    return make


def test_unlike_failures_come_first_and_each_mode_is_bounded(campaigns):
    found = stored_failures([campaigns], per_mode=3)
    assert [case.record.signature for case in found] == ["a", "b", "a", "a"]
    assert len(stored_failures([campaigns], per_mode=9)) == 6


def test_the_parts_of_a_study_share_its_cases(campaigns):
    parts = [stored_failures([campaigns], per_mode=9, part=(i, 2)) for i in (1, 2)]
    names = [case.name for part in parts for case in part]
    assert sorted(names) == sorted(c.name for c in stored_failures([campaigns], per_mode=9))
    assert [len(part) for part in parts] == [3, 3]


@pytest.mark.parametrize("text", ["", "2", "0/2", "3/2", "a/b"])
def test_a_part_that_is_none_is_refused(text):
    with pytest.raises(InputError, match="I/N"):
        parse_part(text)


def test_a_torn_row_is_left_out_and_cut_off_by_the_next(tmp_path):
    append_row(tmp_path, "study", (1, 1), {"case": 1})
    with (tmp_path / "study.jsonl").open("a") as file:
        file.write('{"case": 2, "ru')
    append_row(tmp_path, "study", (2, 2), {"case": 3})
    append_row(tmp_path, "study", (1, 1), {"case": 4})
    assert sorted(row["case"] for row in rows_of(tmp_path, "study")) == [1, 3, 4]


def test_the_table_of_the_minimiser_counts_what_holds_and_names_what_does_not():
    bad = {**ROW, "case": "a/0002", "spare": ["bed1"], "program": "no program"}
    bad["after"] = {**ROW["after"], "robots": 2, "tasks": 5}
    lost = {"case": "b/0000", "signature": "x", "error": "no world"}
    text = minimising.table([ROW, bad, lost])
    assert "3 failures of 2 signatures" in text
    assert "not minimised: b/0000: no world" in text
    assert "1-minimal by the check: 1 of 2" in text
    assert "no more robots than the cycle: 1 of 2 deadlocks" in text
    assert "a/0002: could lose bed1; program: no program; 2 robots, 1 in the cycle" in text
    assert "| same_room_twice_stalls | known world | 1 | 2 | 0 | 0 | 0 |" in text
    assert "burst 0001 (no larger)" in text
    assert "burst 0001 (larger)" in text


def test_whom_a_deadlock_waits_for_is_followed_along_the_edges(hall):
    trace = scripted_trace(hall, seconds=10.0)  # robot1 waits for robot2 from 1 s to 3 s
    waiting = {"robot": "robot1", "cause": "queue", "blocked_by": "robot2", "resource": "store"}
    stuck = dataclasses.replace(
        LATE, spec="no_deadlock", violated_at=2.0, evidence={"cycle": [waiting]}
    )
    assert wait_account(stuck, trace).members == ("robot1",)
    assert wait_account(stuck, trace).holding == ("robot1", "robot2")
    assert wait_account(LATE, trace).holding == ()


def test_the_check_finds_what_a_failure_could_lose(hall, monkeypatch):
    """A stand-in for runs: it fails as long as robot1 and the first task are there."""

    def verdicts(job, *, keep_trace):
        fails = job.world.robots[0].name == "robot1" and job.world.tasks[0].start == 0
        found = dataclasses.replace(LATE) if fails else None
        return type("Run", (), {"verdicts": (found,) if found else ()})

    monkeypatch.setattr(minimising, "judge", verdicts)
    monkeypatch.setattr(minimising, "check_starts", lambda world: None)
    job = Job(world=hall, config=None)
    found = list(minimising.things_that_can_go(job, "deadlines"))
    assert found == ["robot2", "task 1", "human1", "table"]


def test_a_picture_of_a_case_is_small(hall, tmp_path):
    trace = scripted_trace(hall, seconds=10.0)
    waits = [
        {"robot": "robot1", "cause": "barrier", "blocked_by": "robot2", "resource": ""},
        {"robot": "robot2", "cause": "queue", "blocked_by": "robot1", "resource": "store"},
    ]
    stuck = dataclasses.replace(LATE, spec="no_deadlock", evidence={"cycle": waits})
    for name, verdict in (("late", LATE), ("stuck", stuck)):
        seen = Seen(world=hall, trace=trace, verdict=verdict)
        write_picture(seen, seen, tmp_path / f"{name}.png")
        assert 5_000 < (tmp_path / f"{name}.png").stat().st_size < 250_000


@pytest.mark.slow
def test_a_planted_failure_is_minimised_and_every_check_of_it_holds(tmp_path):
    specifications = ("no_deadlock",)
    planted_campaign(tmp_path / "stall", "same_room_twice_stalls", specifications)
    (case,) = stored_failures([tmp_path], per_mode=1)
    row = minimising.study(case, tmp_path / "out", max_runs=20)
    assert row["after"] == {"robots": 1, "tasks": 2, "humans": 0, "furniture": 0, "events": 0}
    assert row["finished"]
    assert row["verified"]
    assert row["kept"]
    assert row["spare"] == []
    assert row["cycle"] == row["waited_for"] == 1
    assert row["program"] in ("identical", "same failure")
    assert not (case.campaign.folder(case.record) / "minimize.json").exists()
