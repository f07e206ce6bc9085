"""What somebody meets who uses the command line for the first time, or an old campaign."""

import dataclasses
import json
import shutil
import sys
from pathlib import Path

import pytest

import mrta_falsify as mf
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import FORMAT_VERSION, Store, read_campaign_settings
from mrta_falsify.cli import campaign_output, compare_command, output
from mrta_falsify.commands import doctor
from mrta_falsify.commands.campaign import run_store
from mrta_falsify.commands.replay import replay
from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.run_result import RunResult, Vote
from mrta_falsify.testing.records import trial_record
from tests.campaigns import standin

RECORDED = Path(__file__).parent.parent / "recorded" / "campaigns"
FIXED = """
model scenic_worlds.model
new Robot with start_room 0
param tasks = [(0, 0, 1, 200)]
param horizon = 2
"""


# --- a resumed campaign keeps its budget ------------------------------------------------------


def begun(directory: Path, *, ran: int, budget: int = 0) -> Path:
    settings = dataclasses.replace(standin.settings(), budget=budget)
    with Store.create(directory, settings) as store:
        run_store(store, Limits(budget=ran), Choice("serial"))
    return directory


def resumed(cli, directory: Path, *args: str):
    result = cli(
        "campaign", "--resume", str(directory), "--executor", "serial", "--format", "json", *args
    )
    assert result.exit_code in (0, 1), result.stderr
    return json.loads(result.stdout)["ran"], result.stderr


def test_a_resumed_campaign_keeps_its_own_budget(cli, tmp_path):
    ran, said = resumed(cli, begun(tmp_path / "c", ran=3, budget=5))
    assert ran == 5
    assert "budget 5, as the campaign began" in said


def test_the_budget_that_was_asked_for_last_is_kept(cli, tmp_path):
    directory = begun(tmp_path / "c", ran=3, budget=5)
    assert resumed(cli, directory, "--budget", "7")[0] == 7
    assert read_campaign_settings(directory).budget == 7
    assert read_campaign_settings(directory).version == FORMAT_VERSION
    assert resumed(cli, directory)[0] == 7


def test_a_campaign_that_recorded_no_budget_keeps_what_it_ran_and_says_so(cli, tmp_path):
    ran, said = resumed(cli, begun(tmp_path / "c", ran=3))
    assert ran == 3
    assert "recorded no budget (the clock ended it, or an older version wrote it); the 3" in said
    assert "--budget" in said


def test_a_new_campaign_records_its_budget(cli, tmp_path):
    (tmp_path / "fixed.scenic").write_text(FIXED)
    result = cli(
        "campaign", "fixed.scenic", "-o", "c", "--budget", "2", "--executor", "serial",
        "--set", "engine=kinematic",
    )  # fmt: skip
    assert result.exit_code in (0, 1), result.stderr
    assert read_campaign_settings(tmp_path / "c").budget == 2
    assert "fixed.scenic: the program has no search dimension" in result.stderr


def test_directories_are_text_or_paths():
    assert mf.open_campaign(str(RECORDED / "beds")).records
    assert len(mf.list(str(RECORDED / "beds"))) == 8
    assert mf.show(RECORDED / "beds", 3).id == mf.show(str(RECORDED / "beds"), "0003").id


# --- another version --------------------------------------------------------------------------


@pytest.mark.long
def test_a_replay_of_another_versions_trial_says_so(cli, tmp_path):
    shutil.copytree(RECORDED / "stalls", tmp_path / "stalls")
    result = cli("replay", "stalls", "4")
    assert result.exit_code == 0, result.stderr
    assert "recorded by another version" in result.stdout


def test_verdicts_decide_on_a_version_whose_digests_differ(tmp_path, monkeypatch):
    shutil.copytree(RECORDED / "stalls", tmp_path / "stalls")
    record = mf.show(tmp_path / "stalls", 4)
    from mrta_falsify.commands import replay as replaying

    def elsewhere(lab, experiments):
        verdicts = record.verdicts if len(seen) == 0 else ()
        seen.append(1)
        for _ in experiments:
            yield RunResult(status="judged", verdicts=verdicts, trace="0" * 64)

    seen: list[int] = []
    monkeypatch.setattr(replaying.Lab, "map", elsewhere)
    same = replay(tmp_path / "stalls", 4)
    assert (same.identical, same.agrees) == (False, True)
    assert not replay(tmp_path / "stalls", 4).agrees


# --- components and formulas of one's own -------------------------------------------------------


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    """A module of the user's own in the current directory, which is not on Python's path."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place not in ("", ".")])
    (tmp_path / "own_lab.py").write_text(
        "from dataclasses import dataclass\n"
        "class Allocator:\n"
        "    @dataclass(frozen=True)\n"
        "    class Options:\n"
        "        pass\n"
    )
    yield tmp_path
    sys.modules.pop("own_lab", None)


def test_a_component_is_found_in_the_current_directory(own_module):
    stack = mf.load_stack(settings=["allocator=own_lab:Allocator"])
    assert registry.load("allocator", stack.allocator.name).__module__ == "own_lab"


def test_a_module_that_is_missing_is_refused_with_the_places_searched(own_module):
    with pytest.raises(ConfigError, match=r"No module named 'own_lib'.*current|looked on Python's"):
        mf.load_stack(settings=["allocator=own_lib:Allocator"])
    with pytest.raises(ConfigError, match=str(own_module)):
        mf.load_stack(settings=["allocator=own_lib:Allocator"])


def test_a_misspelt_signal_is_refused_before_a_trial_runs(cli, tmp_path):
    (tmp_path / "fixed.scenic").write_text(FIXED)
    formula = "stl:always (d_humann > 0.1)"
    for command in (("campaign", "fixed.scenic", "-o", "c"), ("run", "fixed.scenic")):
        result = cli(*command, "--set", "engine=kinematic", "--spec", formula)
        assert result.exit_code == 2, result.output
        assert "unknown signal 'd_humann'; did you mean 'd_human'?" in result.stderr
    assert not (tmp_path / "c").exists()


# --- a plain installation -----------------------------------------------------------------------


def test_doctor_finds_a_machine_without_extras_in_order(monkeypatch):
    absent = tuple(doctor.OPTIONAL)
    loaded = [name for name in sys.modules if name.partition(".")[0] in absent]
    for module in (*absent, *loaded):
        monkeypatch.setitem(sys.modules, module, None)
    for module in ("samplers.map_elites", "mrta_falsify.campaigns.dask_executor"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    checks = (
        doctor._check_plugins(),
        *(doctor._check_extra(extra, modules) for extra, modules in doctor.EXTRAS.items()),
    )
    assert doctor.is_healthy(checks)
    assert "sampler map_elites" in checks[0].detail
    assert {check.state for check in checks[1:]} == {"missing"}
    assert any("pip install '.[qd]'" in check.detail for check in checks)


# --- what is printed ----------------------------------------------------------------------------


def test_tables_fit_80_columns(cli, monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", "80")
    for args in (("list", str(RECORDED / "beds")), ("plugins",)):
        lines = cli(*args).stdout.splitlines()
        lines = [line for line in lines if not line.endswith(".")]  # sentences are not wrapped
        assert max(map(len, lines)) <= 80, args
        assert len(lines) > 8


def test_the_table_of_a_comparison_fits_80_columns(capsys, monkeypatch):
    from mrta_falsify.campaigns.survival import SearchCost
    from mrta_falsify.commands.search_outcomes import SearchOutcome, sampler_rows

    monkeypatch.setenv("COLUMNS", "80")
    one = [
        SearchOutcome(
            simulations=SearchCost(spent=90.0 + i, found=i % 3 == 0),
            seconds=SearchCost(spent=12345.6, found=i % 3 == 0),
            trials=100,
            modes=frozenset(),
        )
        for i in range(12)
    ]
    compare_command._print_samplers(sampler_rows({"evolution": one, "cma_es": one}, 100))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.startswith("evolution") and "4 of 12" in line for line in lines)


def test_a_pipe_gets_a_line_of_progress_now_and_then_with_the_time_left(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    progress = output.PipedProgress("minimize 0004", 100, "runs")
    for second in range(61):
        now[0] = float(second)
        progress.show(second)
    assert capsys.readouterr().err.splitlines() == [
        "minimize 0004: 10/100 runs, about 90 s left".replace("90 s", "2 min"),
        "minimize 0004: 40/100 runs, about 60 s left",
    ]


def test_work_that_may_end_early_says_how_long_it_takes_at_most(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    progress = output.PipedProgress("minimize 0004", 100, "runs", is_most=True)
    now[0] = 60.0
    progress.show(40)
    assert capsys.readouterr().err.splitlines() == [
        "minimize 0004: 40/100 runs, at most 2 min left"
    ]


def test_a_first_run_that_is_longer_does_not_count_in_the_time_left(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    progress = output.PipedProgress("explain 0004", 120, "runs", is_most=True, first_apart=True)
    now[0] = 30.0
    progress.show(1, 100)
    now[0] = 41.0
    progress.show(12, 101)
    assert capsys.readouterr().err.splitlines() == ["explain 0004: 12/101 runs, at most 89 s left"]


@pytest.mark.parametrize(
    ("runs", "each", "copies", "said"),
    [
        (100, 6.0, False, ["at most 100, of about 6.0 s each: 10 min on one core"]),
        (
            120,
            31.5,
            True,
            ["the trial again, about 32 s, then at most 119 further runs; the time left is "
             "shown once some have ended"],
        ),
        (10, 0.5, True, []),
    ],
)  # fmt: skip
def test_the_cost_is_said_before_work_that_does_not_end_soon(capsys, runs, each, copies, said):
    output.say_cost(runs, each, copies=copies)
    assert capsys.readouterr().err.splitlines() == said


def test_the_expected_runs_are_said_beside_the_maximum(capsys):
    output.say_cost(210, 6.0, expected=40, at_end=10)
    said = (
        "about 40 runs, at most 210 (10 of them judge the result), of about 6.0 s each: 4 min on "
        "one core"
    )
    assert capsys.readouterr().err.splitlines() == [said]


def test_a_campaign_in_a_pipe_says_how_long_it_will_take(capsys, monkeypatch, tmp_path):
    from mrta_falsify.campaigns.runner import Progress

    now = [0.0]
    monkeypatch.setattr(campaign_output.time, "monotonic", lambda: now[0])
    counts = Progress(standin.settings(), limits=Limits(budget=40))
    with campaign_output.CampaignWatch(tmp_path) as watch:
        for number in range(8):
            now[0] += 5.0
            record = trial_record(number)
            counts.take(record)
            watch.on_feedback(record, counts)
    (first, second) = capsys.readouterr().err.splitlines()
    assert first.startswith("4/40 trials, 0 failed")
    assert first.endswith("about 3 min left")
    assert second.endswith("about 3 min left")


@pytest.mark.parametrize(("told", "deadlocks"), [(3, 0), (4, 1), (8, 1)])
def test_the_sum_of_a_campaign_counts_what_the_search_knew_when_it_ended(capsys, told, deadlocks):
    from mrta_falsify.campaigns.runner import Progress
    from mrta_falsify.commands.campaign import CampaignResult

    campaign = mf.open_campaign(RECORDED / "beds")
    counts = Progress(campaign.settings, limits=Limits(stop_after=1))
    for record in campaign.records[:told]:
        counts.take(record)
    result = CampaignResult(campaign=campaign, progress=counts, ended="stop-after", wall_s=1.0)
    summary = mf.summarise_campaign(result)
    assert (summary.deadlocks, summary.uncounted) == (deadlocks, 8 - told)
    assert summary.failed == sum(summary.kinds.values()) + summary.afterthoughts
    assert (summary.kinds["deadlock"], summary.kinds["stuck"]) == (0, deadlocks)
    campaign_output.print_campaign(result)
    said = f"{8 - told} more were under way when it ended; they are stored, too"
    assert (said in capsys.readouterr().out) == (told < 8)


def test_failures_that_do_not_stop_a_campaign_are_named(capsys):
    from mrta_falsify.campaigns.runner import Progress
    from mrta_falsify.commands.campaign import CampaignResult

    campaign = mf.open_campaign(RECORDED / "beds")
    counts = Progress(campaign.settings, limits=Limits(stop_after=1))
    few = Vote(runs=4, failed=0)
    for record in campaign.records:
        counts.take(dataclasses.replace(record, vote=few) if record.failed else record)
    result = CampaignResult(campaign=campaign, progress=counts, ended="budget", wall_s=1.0)
    campaign_output.print_campaign(result)
    out = capsys.readouterr().out
    assert "--stop-after 1 counts other failures than these: " in out
    assert "that few perturbed runs share" in out


# --- what to try next -----------------------------------------------------------------------------


CAMPAIGN = ("campaign", "my_ward.scenic", "-o", "found")


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("camapign", "hot_room"), "unknown command 'camapign'; did you mean 'campaign'?"),
        (("list", "nowhere"), "does not exist: `mrta-falsify campaign SCENARIO -o DIR` begins one"),
        (("list", "."), "did you mean runs/beds?"),
        (("report", "out"), "it is that of one run, whose page is out/report.html"),
        (("check", "my_ward"), "did you mean 'my_ward.scenic'?"),
        (("run", "my_ward"), "did you mean 'my_ward.scenic'?"),
        (("run", "my_ward.scenic", "--spec", "no_deadlok"), "--spec: unknown specification"),
        (
            (*CAMPAIGN, "--secondary-spec", "deadlnes"),
            "--secondary-spec: unknown specification 'deadlnes'",
        ),
        ((*CAMPAIGN, "--secondary-spec", "costly_way{factor"), "options must read NAME{opti"),
        ((*CAMPAIGN, "--against", "exec:nowhere"), "--against: there is no program 'nowhere'"),
        (
            (*CAMPAIGN, "--set", "allocator.objectives=1"),
            "objectives is not a known field; did you mean 'objective'? Known: objective, ",
        ),
        ((*CAMPAIGN, "--set", "allocator.zoo=1"), "zoo is not a known field. Known: objective, "),
    ],
)
def test_an_error_says_what_to_try_next(cli, tmp_path, words, hint):
    (tmp_path / "runs").mkdir()
    shutil.copytree(RECORDED / "beds", tmp_path / "runs" / "beds")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "verdicts.json").write_text("[]")
    (tmp_path / "my_ward.scenic").write_text(FIXED)
    result = cli(*words)
    assert result.exit_code == 2
    assert hint in result.stderr
