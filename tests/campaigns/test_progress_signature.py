"""The signature of lost progress says what holds the robot."""

import pytest

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.liveness import held_by


def of_progress(evidence: dict[str, object]) -> str:
    verdict = Verdict(
        spec="progress",
        violated=True,
        robustness=-1.0,
        violated_at=90.0,
        who=("r1",),
        evidence=evidence,
    )
    return signature((verdict,))


@pytest.mark.parametrize(
    ("edges", "expected"),
    [
        ([BlockedBy(0, "wall")], "progress/solid"),
        ([BlockedBy(0, "no-path", -1, "bed")], "progress/solid"),
        ([BlockedBy(0, "no-path", 1)], "progress/robot"),
        ([BlockedBy(0, "human", 0), BlockedBy(0, "barrier", 2)], "progress/person+robot"),
        ([BlockedBy(0, "stalled"), BlockedBy(1, "wall")], "progress/nothing"),
        ([], "progress/nothing"),
    ],
)
def test_it_names_what_holds_the_robot(edges, expected):
    assert of_progress({"held_by": held_by(0, edges)}) == expected


@pytest.mark.parametrize(
    ("held_s", "held", "expected"),
    [
        (42.5, {"robot": 40.0, "person": 3.0}, "progress/robot"),
        (38.5, {"robot": 25.0, "person": 14.0}, "progress/person+robot"),
        (24.3, {"solid": 24.3}, "progress/solid"),
        (8.0, {"robot": 8.0}, "progress/nothing"),
        (0.0, {}, "progress/nothing"),
    ],
)
def test_what_held_the_robot_over_the_whole_time_counts(held_s, held, expected):
    evidence = {"since": 82.0, "time": 172.5, "held_s": held_s, "held": held, "held_by": ["solid"]}
    assert of_progress(evidence) == expected


def test_a_version_that_did_not_tell_is_read():
    assert of_progress({}) == "progress"
