"""A newcomer with nothing but the HTML answers the five questions that they would ask first.

What deadlocked? When? Who waits for whom, and why? Which layer is suspected, and on what
evidence? How do I run it again? The answers are held against what is known of the planted
defects, and the command against what it does.
"""

from __future__ import annotations

import json
import shlex

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.commands import report as reporting
from mrta_falsify.core.defects import defect as planted
from mrta_falsify.specs.attribution import HOLDER_OF_CAUSE
from tests.reports import newcomer
from tests.reports.planted import planted_campaign

#: what is known of each case, from the scene and not from the report
TRUTH = {
    "fourth_waiter_dropped": (
        ("robot5",),
        (
            ("robot5", "ward_0", "kept out by no robot"),
        ),  # without robot2, who is in there, it stays
    ),
    "costmap_blind_to_furniture": (
        ("robot1",),
        (("robot1", "bookshelf", "solid in the way"),),
    ),
}


@pytest.fixture(
    scope="module",
    params=[
        pytest.param("costmap_blind_to_furniture", marks=pytest.mark.slow),
        pytest.param("fourth_waiter_dropped", marks=pytest.mark.long),
    ],
)
def case(request, tmp_path_factory):
    directory = tmp_path_factory.mktemp("planted") / "campaign"
    campaign = planted_campaign(directory, request.param, ("no_deadlock{look_ahead: 40}",))
    html = reporting.write_report(campaign, directory / "report.html").read_text()
    return request.param, campaign, newcomer.read(html)


def test_what_deadlocked(case):
    defect, _, answers = case
    assert answers.deadlocked == TRUTH[defect][0]


def test_when(case):
    _, campaign, answers = case
    (verdict,) = campaign.records[0].verdicts
    assert answers.found == pytest.approx(verdict.violated_at, abs=0.051)
    assert answers.since == pytest.approx(verdict.evidence["onset"], abs=0.051)
    assert answers.since < answers.found


def test_who_waits_for_whom_and_why(case):
    defect, _, answers = case
    assert answers.waits == TRUTH[defect][1]


def test_which_layer_is_suspected_and_on_what_evidence(case):
    defect, campaign, answers = case
    assert answers.layer == planted(defect).layer
    # the evidence names the robot, and what blocked it or how near its path comes to that
    (robot,) = TRUTH[defect][0]
    (verdict,) = campaign.records[0].verdicts
    (cause,) = {edge["cause"] for edge in verdict.evidence["cycle"]}
    assert robot in answers.evidence
    said = "where its rays hit the solid" if cause == "wall" else HOLDER_OF_CAUSE.get(cause, cause)
    assert said in answers.evidence


def test_the_command_for_running_it_again_gives_the_same_run(case):
    _, _, answers = case
    program, *words = shlex.split(answers.again)
    assert program == "mrta-falsify"
    result = CliRunner().invoke(main, [*words, "--format", "json"])
    assert result.exit_code == 0, result.stderr
    data = json.loads(result.stdout)
    assert data["identical"] == data["runs"] == 3
