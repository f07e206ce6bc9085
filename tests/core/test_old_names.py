"""Old names of records and modules answer, and warn with what says the same now."""

from __future__ import annotations

import importlib
import subprocess
import sys
import warnings

import numpy as np
import pytest

from mrta_falsify.analysis.explain import rows
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.record import OtherRun, TrialRecord
from mrta_falsify.core.run_result import RunResult

CANDIDATE = Candidate(number=0, u=np.zeros(1), seed=1)


def record(rank="none", **more):
    return TrialRecord(candidate=CANDIDATE, result=RunResult(status="judged", rank=rank), **more)


def asked(one, name, now):
    with pytest.warns(DeprecationWarning, match=f"TrialRecord.{name} is called {now} now"):
        return getattr(one, name)


@pytest.mark.parametrize(
    ("rank", "is_reported", "is_afterthought"),
    [("none", False, False), ("secondary", True, True), ("primary", True, False)],
)
def test_what_a_failure_counts_for(rank, is_reported, is_afterthought):
    one = record(rank)
    assert asked(one, "is_reported", 'rank != "none"') is is_reported
    assert asked(one, "is_afterthought", 'rank == "secondary"') is is_afterthought
    assert asked(one, "is_sought", "is_primary") is (rank == "primary")


@pytest.mark.parametrize("fate", ["passes", "fails", "not judged"])
def test_what_the_other_stack_did(fate):
    one = record("primary", other=OtherRun(fate=fate, score=0.0))
    assert asked(one, "fails_on_both", 'other.fate == "fails"') is (fate == "fails")


def test_without_another_stack_a_record_does_not_fail_on_both():
    assert asked(record("primary"), "fails_on_both", 'other.fate == "fails"') is False


def test_runs_on_other_engines():
    assert asked(record(), "confirmed", "engines") == ()


def test_a_name_that_never_was_is_none():
    with pytest.raises(AttributeError, match="has no attribute 'is_found'"):
        _ = record().is_found


def test_modules_of_a_renamed_package_answer_by_their_old_names():
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        told = importlib.import_module("mrta_falsify.verbs.explain.rows").told
        with pytest.raises(ModuleNotFoundError):
            importlib.import_module("mrta_falsify.verbs.nothing_of_the_kind")
    said = "mrta_falsify.verbs.explain.rows is called mrta_falsify.analysis.explain.rows now"
    assert said in [str(warning.message) for warning in seen]
    assert told is rows.told


def test_a_module_is_run_by_its_old_name():
    command = [sys.executable, "-m", "mrta_falsify.verbs.certify.checker", "nowhere"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "nowhere" in done.stderr.splitlines()[-1]
    assert "No module named" not in done.stderr
