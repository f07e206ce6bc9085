"""Findings come back from their files, those of the version before included."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from mrta_falsify.campaigns.finding_files import (
    FILE_NAMES,
    FINDING_VERSION,
    read_finding,
    write_finding,
)
from mrta_falsify.core.difference import Difference
from mrta_falsify.core.errors import FormatError, InputError
from mrta_falsify.core.findings import (
    Certificate,
    CertifiedMember,
    Counterfactual,
    Explanation,
    Minimisation,
    Removal,
    ReplayCheck,
    Standing,
)
from mrta_falsify.core.run_result import Vote
from mrta_falsify.core.verdict import Verdict
from tests.reports.decided import DECIDED as INEVITABILITY

RECORDED = Path(__file__).parent.parent / "recorded" / "campaigns"
EXPLANATION = Explanation(
    layer="planner",
    guess="controller",
    reason="changing it, and nothing else, removes the failure",
    changed_at=12.5,
    counterfactuals=(Counterfactual(layer="planner", change="planner: ompl", failure_gone=True),),
    jittered=Vote(runs=20, failed=18),
    runs=33,
    removals=(Removal(robot="a", time=22.5, go_on=("b",), stay=("c",)),),
)
DECIDED = dataclasses.replace(EXPLANATION, inevitability=INEVITABILITY)
MINIMISATION = Minimisation(
    signature="no_deadlock/1:stalled",
    removed=("2 of 3 robots",),
    runs=19,
    one_minimal=True,
    counts={"robots": (3, 1), "tasks": (1, 1)},
    world_digest="ab",
    trace_digest="cd",
    verdicts=(Verdict(spec="no_deadlock", robustness=-1.0, violated=True, violated_at=9.0),),
    program="identical",
)
CHECK = ReplayCheck(
    runs=3,
    identical=2,
    same_verdicts=3,
    same_machine=False,
    first_difference=Difference(tick=7, time=0.35, what="pose", who="robot1", size=1e-9),
)
CERTIFICATE = Certificate(
    world="ab",
    trace="cd",
    read="ef",
    since=3.5,
    until=9.0,
    members=(CertifiedMember(name="a", pose=(0.5, 1.0), goal=(4.0, 1.0), area="", robots=("b",)),),
    resting=(Standing(name="b", pose=(1.0, 1.0)),),
    digest="0f",
)
#: kinds that the recorded campaigns have
RECORDED_KINDS = [kind for kind in FILE_NAMES if kind is not Certificate]


@pytest.mark.parametrize("finding", [EXPLANATION, DECIDED, MINIMISATION, CHECK, CERTIFICATE])
def test_a_finding_comes_back_as_it_was(tmp_path, finding):
    write_finding(tmp_path, finding)
    assert read_finding(tmp_path, type(finding)) == finding
    data = json.loads((tmp_path / FILE_NAMES[type(finding)]).read_text())
    assert data["version"] == FINDING_VERSION


def test_an_explanation_without_rewinding_is_written_as_before(tmp_path):
    write_finding(tmp_path, EXPLANATION)
    assert "inevitability" not in json.loads((tmp_path / "explain.json").read_text())


def test_programs_find_when_and_by_what_a_failure_was_decided(tmp_path):
    write_finding(tmp_path, DECIDED)
    told = json.loads((tmp_path / "explain.json").read_text())["inevitability"]
    assert (told["decided_at"], told["by"]) == (31.4, "queue_policy")
    assert [curve["replaced"] for curve in told["curves"]] == ["nothing", "layer"]
    point = told["curves"][1]["points"][1]
    assert point["time"] == 31.0
    assert (point["chance"]["failures"], point["chance"]["trials"]) == (1, 6)


def test_what_follows_from_a_finding_is_written_for_readers(tmp_path):
    write_finding(tmp_path, MINIMISATION)
    assert json.loads((tmp_path / "minimize.json").read_text())["share_removed"] == 0.5
    damaged = (tmp_path / "minimize.json").read_text().replace("0.5", '"x"')
    (tmp_path / "minimize.json").write_text(damaged)
    with pytest.raises(
        FormatError, match=r"minimize\.json: share_removed is 'x'; it must be a numb"
    ):
        read_finding(tmp_path, Minimisation)


def assert_says_all(now, then):
    """What ``then`` says is in ``now``, field by field; fields that came later may be added."""
    if isinstance(then, dict):
        assert set(then) <= set(now)
        for key, value in then.items():
            assert_says_all(now[key], value)
    elif isinstance(then, list):
        assert len(now) == len(then)
        for new, old in zip(now, then, strict=True):
            assert_says_all(new, old)
    else:
        assert now == then


@pytest.mark.parametrize("campaign", ["beds", "stalls"])
@pytest.mark.parametrize("kind", RECORDED_KINDS, ids=lambda kind: kind.__name__)
def test_findings_of_the_version_before_are_read_with_all_they_say(tmp_path, campaign, kind):
    (path,) = RECORDED.glob(f"{campaign}/trials/*/{FILE_NAMES[kind]}")
    then = json.loads(path.read_text())
    found = read_finding(path.parent, kind)
    assert found is not None
    write_finding(tmp_path, found)
    now = json.loads((tmp_path / path.name).read_text())
    assert_says_all(now, then)


def test_a_finding_that_is_not_there_is_none(tmp_path):
    assert read_finding(tmp_path, Explanation) is None


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("{", FormatError, "is not valid JSON"),
        ("[]", InputError, "it must be an object with named fields"),
        ('{"layer": "planner"}', InputError, "guess is missing"),
        ('{"version": 3}', FormatError, "has format version 3; this toolkit reads versions 1 to 2"),
    ],
)
def test_a_damaged_finding_is_refused_with_its_file_and_field(tmp_path, text, error, message):
    (tmp_path / "explain.json").write_text(text)
    with pytest.raises(error, match=message) as caught:
        read_finding(tmp_path, Explanation)
    assert str(tmp_path / "explain.json") in str(caught.value)
