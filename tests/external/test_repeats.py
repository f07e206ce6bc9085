"""A failure of a foreign stack is run again, nothing changed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

import mrta_falsify as mf
from mrta_falsify.campaigns.stats import RepeatCounts
from mrta_falsify.cli.group import main
from mrta_falsify.commands.stacks import load_stack
from mrta_falsify.core import codec
from mrta_falsify.core.probability import failure_probability
from mrta_falsify.core.record import Repeats, TrialRecord
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.lab import RunResult
from mrta_falsify.trial import campaign_specifications
from mrta_falsify.worker import counted_repeats
from tests.quick_program import PROGRAM

ROOT = Path(__file__).resolve().parents[2]


def result(*verdicts: Verdict, trace: str = "d") -> RunResult:
    return RunResult(status="judged", verdicts=verdicts, trace=trace)


def violated(spec: str) -> Verdict:
    return Verdict(spec=spec, robustness=-1.0, violated=True, violated_at=1.0)


def test_runs_are_counted_by_what_became_of_the_failure():
    first = result(violated("progress"))
    runs = [
        result(violated("progress")),
        result(violated("deadlines")),
        result(unjudged("progress", "no goals")),
        result(Verdict(spec="progress", robustness=1.0, violated=False)),
        RunResult(status="impossible", detail="the stack did not start"),
    ]
    found = counted_repeats(first, runs)
    assert (found.same.failures, found.same.trials, found.same.undecided) == (1, 3, 2)
    assert (found.otherwise, found.identical, found.runs) == (1, 4, 5)
    assert 0.0 < found.same.low < 1 / 3 < found.same.high < 1.0


def test_a_count_says_its_interval_and_what_else_happened():
    same = failure_probability(30, 40)
    text = str(Repeats(same=same, otherwise=10, identical=0))
    low, high = f"{same.low:.2f}", f"{same.high:.2f}"
    assert text == (
        f"the same run fails again in 30 of 40 (95% interval {low} to {high}); it fails in another "
        "way in 10"
    )
    few = Repeats(same=failure_probability(3, 4, undecided=1), otherwise=1, identical=0)
    assert str(few) == (
        "the same run fails again in 3 of 5 (too few runs for a 95% interval); it fails in another "
        "way in 1; 1 could not be judged"
    )


def test_noise_is_no_failure_of_a_campaign_unless_the_user_asks_for_it():
    inside = campaign_specifications()
    outside = campaign_specifications(load_stack(f"exec:{sys.executable} x.py"))
    assert set(inside) - set(outside) == {"repeatable"}


@pytest.fixture
def search(tmp_path, monkeypatch):
    """Search a shipped scenario with a noisy stack until it has failed once."""
    monkeypatch.chdir(tmp_path)

    def found(source: str, **more):
        command = [sys.executable, str(Path(__file__).with_name("noisy_stack.py")), source, "10"]
        stack = {"command": command, "env": {"PYTHONPATH": str(ROOT)}}
        Path("short.scenic").write_text(PROGRAM.replace("horizon = 35", "horizon = 2"))
        Path("stack.yaml").write_text(yaml.safe_dump({"engine": "kinematic", "stack": stack}))
        mf.campaign(
            "short.scenic",
            stack="stack.yaml",
            output="runs",
            budget=30,
            stop_after=1,
            specs=["stack_runs"],
            executor="serial",
            **more,
        )
        (row,) = mf.list("runs", failed=True)
        return mf.show("runs", row.id)

    return found


@pytest.mark.long
def test_a_failure_by_chance_comes_again_now_and_then(search):
    record = search("coin", verify=20)
    assert record.result.coupling == "stepped"
    found = record.repeats
    assert 0 < found.same.failures < 20  # fails once in half a million
    assert found.same.trials == 20
    assert found.same.low < found.same.estimate < found.same.high
    campaign = mf.open_campaign("runs")
    assert mf.resume_campaign("runs", stop_after=1).progress.failed == 1
    summary = mf.summarise_campaign(mf.resume_campaign("runs", stop_after=1))
    assert summary.repeated == RepeatCounts(always=0, sometimes=1, never=0)
    for command in (["list", "runs"], ["show", "runs", record.id]):
        assert CliRunner().invoke(main, command).output.count(f"{found.same.failures} of 20") == 1
    (page,) = mf.report("runs")
    assert str(found) in page.read_text()
    data = codec.encode(campaign.record(record.id))
    assert codec.decode(TrialRecord, data, where="record").repeats == found


@pytest.mark.slow
def test_a_failure_of_a_deterministic_stack_comes_again_every_time(search):
    found = search("raises").repeats
    assert (found.same.failures, found.same.trials, found.identical) == (4, 4, 4)
    assert found.same.high == 1.0


@pytest.mark.long
def test_nothing_is_run_again_where_the_user_does_not_want_it(search):
    assert search("raises", verify=0).repeats is None
