"""The signature of lost progress says what holds the robot."""

import pytest

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core.verdict import Verdict


@pytest.mark.parametrize(
    ("evidence", "expected"),
    [
        ({"causes": ["wall"]}, "progress/solid"),
        ({"causes": ["human", "barrier", "cluster"]}, "progress/person+robot"),
        ({"causes": ["stalled"]}, "progress/nothing"),
        ({"causes": []}, "progress/nothing"),
        ({}, "progress"),  # as stored by a version that did not tell
    ],
)
def test_it_names_what_holds_the_robot(evidence: dict[str, object], expected: str) -> None:
    verdict = Verdict(
        spec="progress",
        violated=True,
        robustness=-1.0,
        violated_at=90.0,
        who=("r1",),
        evidence=evidence,
    )
    assert signature((verdict,)) == expected
