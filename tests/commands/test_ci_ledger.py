"""The life of findings between two runs, and the project file."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from xml.etree import ElementTree

import pytest

from mrta_falsify.campaigns.rules import JUDGED_SINCE
from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.campaigns.store import read_campaign
from mrta_falsify.commands.ci import cell_run, ledger, running
from mrta_falsify.commands.ci.cells import Cell, _stored_findings
from mrta_falsify.commands.ci.ledger import CellState, Example, Finding, changes_of, merged
from mrta_falsify.commands.ci.project import read_project
from mrta_falsify.commands.ci.reporting import contents_of, junit_of
from mrta_falsify.commands.ci.running import CellOutcome, CiResult
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Recheck
from mrta_falsify.specs.causes import kind_of
from reports.markdown import render_markdown

RECORDED = Path(__file__).parent.parent / "recorded" / "campaigns"
HERE = Example("runs/first", "0001")


def finding(mode: str, fate: str = "failing", since: int = 1, id: str = "0001") -> Finding:
    return Finding(
        signature=mode,
        fate=fate,
        examples=(Example("runs/first", id),),
        sentence=f"{mode} happens.",
        since=since,
    )


def kinds(before: list[Finding], now: list[Finding]) -> dict[str, str]:
    states = [CellState(name="c", parts={}, findings=tuple(found)) for found in (before, now)]
    return {change.signature: change.kind for change in changes_of(*states)}


def test_each_finding_is_new_ongoing_flaky_or_resolved():
    before = [finding("a"), finding("b"), finding("c"), finding("d", "resolved"), finding("e")]
    now = merged(
        before, [finding("a"), finding("b", "flaky"), finding("f")], undecided=["e"], number=2
    )
    assert kinds(before, list(now)) == {
        "a": "ongoing",
        "b": "flaky",
        "c": "resolved",
        "e": "ongoing",
        "f": "new",
    }
    assert {one.signature: one.fate for one in now}["d"] == "resolved"
    assert {one.signature: one.since for one in now} == {**dict.fromkeys("abcde", 1), "f": 2}


def test_what_was_resolved_and_fails_again_came_back():
    before = CellState(name="c", parts={}, findings=(finding("a", "resolved"),))
    now = CellState(
        name="c", parts={}, findings=merged(before.findings, [finding("a")], (), number=5)
    )
    (change,) = changes_of(before, now)
    assert (change.kind, change.came_back, change.since) == ("new", True, 5)


def test_the_worse_of_two_fates_counts_and_both_worlds_are_kept():
    seen = [finding("a", "flaky", id="0001"), finding("a", "failing", id="0002")]
    (one,) = merged([], seen, (), number=1)
    assert one.fate == "failing"
    assert [example.id for example in one.examples] == ["0002", "0001"]


@pytest.mark.parametrize(
    ("fate", "failures", "expected", "mode"),
    [
        ("still failing", 2, "failing", "new mode"),
        ("still failing", 0, "flaky", "new mode"),
        ("flaky", 2, "failing", "old mode"),
        ("flaky", 1, "flaky", "old mode"),
        ("fixed", 0, "resolved", "old mode"),
        ("timeout", 0, None, None),
        ("not judged", 0, None, None),
    ],
)
def test_most_runs_of_a_world_and_its_copies_decide(fate, failures, expected, mode):
    row = Recheck(
        id="0001",
        fate=fate,
        signature="old mode",
        violated=(),
        signature_now="new mode",
        jittered_failures=failures,
        jittered=2,
        forms_now=("new mode", "new mode before"),
    )
    found = cell_run._finding_of(finding("old mode"), HERE, row, 3)
    assert (found and found.fate, found and found.signature) == (expected, mode)


# --- modes of earlier rules ------------------------------------------------------------------


def signed(now: str, *before: str, fate: str = "failing", since: int = 9) -> Finding:
    """A finding of today's rules."""
    return dataclasses.replace(finding(now, fate, since), rules=JUDGED_SINCE, before=before)


def test_a_mode_of_earlier_rules_goes_on_in_its_form():
    old = [finding("1:wall"), finding("deadlines"), finding("2:wall,wall", since=4)]
    now = merged(
        old,
        [
            signed("stuck:wall", "1:wall"),
            signed("shut:bed", "1:wall"),
            signed("deadlines", "deadlines"),
            signed("stuck:no-path", "1:wall", "2:wall,wall"),
        ],
        (),
        number=9,
    )  # fmt: skip
    assert kinds(old, list(now)) == dict.fromkeys(
        ("stuck:wall", "shut:bed", "deadlines", "stuck:no-path"), "ongoing"
    )
    assert {one.since for one in now} == {1}
    again = merged(now, now, (), number=10)
    assert set(kinds(list(now), list(again)).values()) == {"ongoing"}


def test_of_earlier_rules_only_what_is_not_seen_is_resolved_and_it_may_come_back():
    old = [finding("1:wall"), finding("2:barrier")]
    now = merged(old, [signed("stuck:wall", "1:wall")], (), number=2)
    assert kinds(old, list(now)) == {"stuck:wall": "ongoing", "2:barrier": "resolved"}
    later = merged(now, [signed("2:barrier", "2:barrier"), signed("new", "other")], (), number=3)
    (back,) = [change for change in changes_of(
        CellState(name="c", parts={}, findings=now), CellState(name="c", parts={}, findings=later)
    ) if change.signature == "2:barrier"]  # fmt: skip
    assert (back.kind, back.came_back, back.since) == ("new", True, 3)
    assert kinds(list(now), list(later))["new"] == "new"


def test_a_world_that_only_fails_in_copies_keeps_the_form_of_its_mode():
    old = [finding("1:wall")]
    seen = [finding("1:wall", "flaky"), signed("stuck:wall", "1:wall")]
    (one,) = merged(old, seen, (), number=2)
    assert (one.signature, one.rules, one.fate) == ("stuck:wall", JUDGED_SINCE, "failing")
    (alone,) = merged(old, seen[:1], (), number=2)
    assert (alone.signature, alone.rules, alone.fate) == ("1:wall", 1, "flaky")


@pytest.mark.parametrize("name", ["beds", "stalls"])
def test_a_stored_corpus_of_earlier_rules_goes_on_mode_by_mode(name, tmp_path):
    """Each of its failures is found again, with the evidence that a run has today."""
    (tmp_path / "mrta-falsify.yaml").write_text("corpus: [c]\n")
    project = read_project(tmp_path)
    campaign = read_campaign(RECORDED / name)
    known = _stored_findings(project, campaign)
    seen = []
    for record in campaign.records:
        if not record.failed:
            continue
        today = [_as_judged_today(verdict) for verdict in record.verdicts]
        violated = tuple(verdict.spec for verdict in today if verdict.violated)
        row = Recheck(
            id=record.id, fate="still failing", signature="", violated=violated,
            signature_now="", jittered_failures=0, jittered=0, kind_now=kind_of(today),
            forms_now=(signature(today), signature_before(today)),
        )  # fmt: skip
        (of,) = [one for one in known if record.id in {e.id for e in one.examples}]
        seen.append(cell_run._finding_of(of, HERE, row, 2))
    now = merged(known, seen, (), number=2)
    assert set(kinds(list(known), list(now)).values()) == {"ongoing"}
    assert {one.rules for one in now} == {JUDGED_SINCE}


def _as_judged_today(verdict):
    if verdict.spec != "no_deadlock" or not verdict.violated:
        return verdict
    rows = verdict.evidence["cycle"]
    corrected = [{**row, "cause": "no-path", "resource": "bed1"} for row in rows]
    today = {"kind": "shut", "shut_by": ["bed1"], "cycle": corrected, "cycle_seen": rows}
    return dataclasses.replace(verdict, evidence={**verdict.evidence, **today})


def test_a_ledger_is_read_as_it_was_written(tmp_path):
    cell = CellState(name="c", parts={"code": "1"}, findings=(finding("a"),))
    written = ledger.Ledger(number=3, ended="2026-01-01 10:00", cells=(cell,))
    ledger.write_ledger(tmp_path, written)
    assert ledger.read_ledger(tmp_path) == written
    assert ledger.read_ledger(tmp_path / "nowhere") == ledger.Ledger()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('{"version": 9}', "has format version 9; this reads 1"),
        ('{"version": 1, "number": "x"}', "number is 'x'; it must be a whole number"),
        ("{", "is not valid JSON"),
    ],
)
def test_a_damaged_ledger_is_refused(tmp_path, text, complaint):
    (tmp_path / ledger.LEDGER_NAME).write_text(text)
    with pytest.raises(InputError, match=complaint):
        ledger.read_ledger(tmp_path)


# --- the report ------------------------------------------------------------------------------


def test_the_report_tells_every_change_in_all_forms(tmp_path):
    (tmp_path / "mrta-falsify.yaml").write_text("scenarios: {hot_room: }\n")
    project = read_project(tmp_path)
    before = CellState(name="c", parts={}, findings=(finding("old"), finding("gone")))
    now = CellState(
        name="c",
        parts={},
        findings=merged(before.findings, [finding("old"), finding("fresh")], (), number=2),
    )
    result = CiResult(
        project="p",
        number=2,
        last="yesterday",
        cells=(
            CellOutcome(name="c", changed=("code",), trials=5, rechecked=2),
            CellOutcome(name="quiet", changed=()),
        ),
        changes=changes_of(before, now),
        at_rest=0,
    )
    text = render_markdown(contents_of(project, result))
    assert "1 new, 1 ongoing, 0 flaky, 1 resolved; against the run of yesterday" in text
    assert "- c: 5 trials, 2 known failures again (changed: code)" in text
    assert "- quiet: not run: nothing has changed" in text
    suite = ElementTree.fromstring(junit_of(project, result).encode())
    assert (suite.get("tests"), suite.get("failures")) == ("4", "2")
    assert result.fails
    assert not dataclasses.replace(result, changes=()).fails


# --- the project file ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            "scenarios: {hot_room: {buget: 3}}",
            r"scenarios\.hot_room\.buget is not a known field; did you mean 'budget'",
        ),
        ("scenarios: {hot_room: {budget: 0}}", r"hot_room\.budget is 0; it must be >= 1"),
        (
            "scenarios: {hot_room: {stacks: [mien]}}\nstacks: {mine: default}",
            "unknown stack 'mien'; did you mean 'mine'",
        ),
        ("scenaros: {}", "scenaros is not a known field; did you mean 'scenarios'"),
        ("stacks: {mine: {file: a.yaml}}", r"stacks\.mine\.file is not a known field"),
        ("", "names no scenarios and no corpus"),
        ("- a", r"top level is \['a'\]; it must be an object"),
        ("scenarios: [", "is not valid YAML"),
    ],
)
def test_a_wrong_project_file_is_refused_with_what_is_allowed(tmp_path, text, complaint):
    path = tmp_path / "mrta-falsify.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_project(path)


def test_a_missing_project_file_is_named(tmp_path):
    with pytest.raises(InputError, match="there is no such project file"):
        read_project(tmp_path / "other.yaml")


def test_a_stack_file_that_is_missing_is_named_with_where_it_stands(tmp_path):
    (tmp_path / "mrta-falsify.yaml").write_text("corpus: [one]\nstacks: {mine: stack.yaml}\n")
    project = read_project(tmp_path)
    with pytest.raises(InputError, match=r"stacks\.mine: there is no file .*`mrta-falsify init`"):
        project.stack("mine")


def test_stacks_and_scenarios_are_looked_for_beside_the_file(tmp_path):
    (tmp_path / "own.scenic").write_text("model scenic_worlds.model\n")
    (tmp_path / "fast.yaml").write_text("planner: {resolution: 0.1}\n")
    (tmp_path / "mrta-falsify.yaml").write_text(
        "scenarios: {own.scenic: {budget: 3}, hot_room: }\n"
        "stacks:\n"
        "  fast: fast.yaml\n"
        "  quick: {stack: default, settings: [engine=kinematic]}\n"
        "  foreign: exec:python3 stack.py\n"
    )
    project = read_project(tmp_path)
    assert project.scenario("own.scenic") == str(tmp_path / "own.scenic")
    assert project.scenario("hot_room") == "hot_room"
    assert project.file.scenarios["hot_room"].budget == 20
    assert project.stack("fast").planner == Choice("astar", {"resolution": 0.1})
    assert project.stack("quick").engine.name == "kinematic"
    foreign = project.stack("foreign").stack
    assert foreign is not None
    assert foreign.folder == str(tmp_path)


# --- interruption ----------------------------------------------------------------------------


def test_an_interrupted_run_keeps_what_is_finished_and_leaves_the_last_run_in_place(
    tmp_path, monkeypatch
):
    (tmp_path / "mrta-falsify.yaml").write_text("corpus: [one, two]\n")
    project = read_project(tmp_path)
    stored = dataclasses.replace(
        finding("a"), examples=(Example("one", "0001"), Example("two", "0002"))
    )
    cell = Cell(name="c", config=StackConfig(), parts={"corpus": "1"}, jittered=0, corpus=(stored,))
    asked, stops = [], [True, False][::-1]

    def recheck(campaign, *, only, **options):
        asked.append(campaign.name)
        if campaign.name == "two" and stops.pop():
            raise KeyboardInterrupt
        row = Recheck(
            id=only[0],
            fate="fixed",
            signature="a",
            violated=(),
            signature_now="",
            jittered_failures=0,
            jittered=0,
        )
        return (row,)

    monkeypatch.setattr(running, "cells_of", lambda project: [cell])
    monkeypatch.setattr(cell_run, "open_to_run", lambda directory, trust: directory)
    monkeypatch.setattr(cell_run, "permit_rechecks", lambda *args, **options: None)
    monkeypatch.setattr(cell_run, "on_recorded_engine", lambda campaign, config: config)
    monkeypatch.setattr(cell_run, "recheck", recheck)
    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        running.run_project(project, workers=1)
    assert ledger.read_ledger(project.kept) == ledger.Ledger()

    def stopped(result):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        running.run_project(project, workers=1, on_result=stopped)
    assert ledger.read_ledger(project.kept) == ledger.Ledger()
    result = running.run_project(project, workers=1)
    assert asked == ["one", "two", "two"]
    assert [change.kind for change in result.changes] == ["resolved"]
    assert not (project.kept / running.JOURNAL_NAME).exists()
    again = running.run_project(project, workers=1)
    assert (again.changes, again.at_rest, again.cells[0].changed) == ((), 1, ())
    assert len(asked) == 3
