"""Later versions do what the recorded one did, and read what it stored."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.campaigns.rules import JUDGED_SINCE
from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.campaigns.store import read_campaign
from mrta_falsify.cli import main
from mrta_falsify.commands.ci.ledger import Example, Finding, changes_of, merged, read_ledger
from mrta_falsify.core.record import versions
from tests.recorded.record import (
    CAMPAIGNS,
    ENGINES,
    SEARCHES,
    differences,
    outcome_of,
    stored_cases,
)

CASES = {case["name"]: case for case in stored_cases()}
#: cases that run every layer in seconds; a slow one stands for answers that come late
QUICK = ("follower_zero_command", "narrow_pair")
#: what tells failures apart on any machine; digests hold on machines of one type
ANYWHERE = ("world_digest", "ended", "signature", "layer")


def _recorded_here() -> bool:
    """Whether libraries and machine are those of the record; our own version may be another."""
    then = dict(read_campaign(CAMPAIGNS / "beds").records[0].origin.versions)
    return then | {"mrta-falsify": ""} == versions() | {"mrta-falsify": ""}


def _check(name: str, engine: str) -> None:
    case = CASES[name]
    found = differences(case, engine, outcome_of(name, case["stack"], engine))
    if not _recorded_here():
        found = [line for line in found if line.split(": ")[1].split()[0] in ANYWHERE]
    assert found == []


@pytest.mark.parametrize(
    "name", [*QUICK, pytest.param("late_feedback_unsat", marks=pytest.mark.slow)]
)
def test_a_recorded_run_is_the_same_now(name):
    _check(name, "kinematic")


@pytest.mark.long
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", sorted(CASES))
def test_every_recorded_run_is_the_same_now(name, engine):
    _check(name, engine)


@pytest.fixture
def stored(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A copy of a stored campaign, since commands keep files in it."""
    place = tmp_path / request.param
    shutil.copytree(CAMPAIGNS / request.param, place)
    return place


def _first_failure(name: str) -> dict[str, str]:
    rows = json.loads((CAMPAIGNS / f"{name}.list.json").read_text())
    return next(row for row in rows if row["failed"])


def _run(*words: str) -> str:
    result = CliRunner().invoke(main, list(words))
    assert result.exit_code in (0, 1), result.output
    return result.stdout


@pytest.mark.parametrize("stored", SEARCHES, indirect=True)
def test_a_stored_campaign_is_listed_as_before(stored):
    before = json.loads((CAMPAIGNS / f"{stored.name}.list.json").read_text())
    now = json.loads(_run("list", str(stored), "--format", "json"))
    assert [{key: row[key] for key in before[0]} for row in now] == before
    assert all(bool(row["headline"]) == row["failed"] for row in now)


@pytest.mark.parametrize("stored", SEARCHES, indirect=True)
def test_a_stored_campaign_is_shown_and_reported(stored):
    first = _first_failure(stored.name)
    folder = stored / "trials" / first["id"]
    kept = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert "family.json" in kept  # of a command that is no more
    shown = json.loads(_run("show", str(stored), first["id"], "--format", "json"))
    assert shown["signature"] == first["signature"]
    _run("report", str(stored), "--markdown", str(stored / "report.md"))
    page, text = (stored / "report.html").read_text(), (stored / "report.md").read_text()
    assert first["id"] in page
    explained = json.loads(kept["explain.json"])
    assert explained["layer"].replace("_", " ") in text.replace("_", " ")
    assert "damaged" not in page
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == kept


@pytest.mark.long
@pytest.mark.parametrize("stored", SEARCHES, indirect=True)
def test_a_stored_corpus_has_the_same_fates(stored):
    before = json.loads((CAMPAIGNS / f"{stored.name}.corpus.json").read_text())
    now = json.loads(_run("corpus", str(stored), "--format", "json"))
    assert list(map(_fate, now["failures"])) == list(map(_fate, before["failures"]))


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of a project that commit 73399d2 has run once."""
    shutil.copytree(CAMPAIGNS.parent / "ledger", tmp_path / "project")
    return tmp_path / "project"


def test_modes_of_a_stored_ledger_go_on_under_the_signatures_of_today(project):
    (cell,) = read_ledger(project / "kept").cells
    seen = []
    for folder in (project / "kept" / "campaigns").iterdir():
        for record in read_campaign(folder).records:
            now = Finding(
                signature=signature(record.verdicts),
                fate="failing",
                examples=(Example(str(folder), record.id),),
                sentence="",
                since=2,
                rules=JUDGED_SINCE,
                before=(signature_before(record.verdicts),),
            )
            seen += [now] if record.failed else []
    assert {finding.rules for finding in cell.findings} == {1}
    found = dataclasses.replace(cell, findings=merged(cell.findings, seen, (), 2))
    changes = changes_of(cell, found)
    assert [(change.kind, change.since) for change in changes] == [("ongoing", 1)]
    assert {finding.rules for finding in found.findings} == {JUDGED_SINCE}


@pytest.mark.long
@pytest.mark.timeout(1800)  # the project is as it was recorded, each perturbed run to its horizon
def test_no_mode_of_a_stored_ledger_is_new_or_resolved_by_the_update(project):
    first = json.loads(_run("ci", str(project), "--trust", "--format", "json", "--workers", "1"))
    assert (first["new"], first["resolved"], first["ongoing"]) == (0, 0, 1)
    again = json.loads(
        _run("ci", str(project), "--trust", "--all", "--format", "json", "--workers", "1")
    )
    assert (again["new"], again["resolved"], again["ongoing"]) == (0, 0, 1)


@pytest.mark.parametrize("stored", SEARCHES, indirect=True)
def test_a_stored_campaign_does_not_go_on_and_is_left_as_it_is(stored):
    before = {path: path.read_bytes() for path in stored.rglob("*") if path.is_file()}
    result = CliRunner().invoke(main, ["campaign", "--resume", str(stored), "--budget", "99"])
    assert result.exit_code == 2
    assert "73399d2" in result.stderr
    assert {path: path.read_bytes() for path in stored.rglob("*") if path.is_file()} == before


def _fate(row):
    """The signature ends with the kind of place now, with the name of the queue or room before."""
    return row["id"], row["fate"], row["signature"].split("/")[:2]


@pytest.mark.long
@pytest.mark.parametrize("stored", ["stalls"], indirect=True)
def test_the_replay_of_a_stored_campaign_compares_verdicts(stored):
    first = _first_failure("stalls")
    data = json.loads(_run("replay", str(stored), first["id"], "--format", "json"))
    assert data["same_verdicts"] == 1
