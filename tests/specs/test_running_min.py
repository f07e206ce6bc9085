"""A verdict names who violated the specification at the time that it gives."""

from __future__ import annotations

from mrta_falsify.specs.running_min import RunningMin


def test_a_later_and_worse_violation_is_told_by_its_margin_only():
    least = RunningMin("exclusive_use", 5.0)
    least.note(0.2, 1.0, ("robot1", "robot2"), {"room": 0})
    least.note(-0.1, 2.0, ("robot3", "robot4"), {"room": 1})
    least.note(-0.5, 9.0, ("robot5", "robot6"), {"room": 2})
    verdict = least.verdict()
    assert verdict.violated
    assert verdict.robustness == -0.5
    assert (verdict.violated_at, verdict.who) == (2.0, ("robot3", "robot4"))
    assert verdict.evidence == {"room": 1}


def test_before_a_violation_the_evidence_is_of_the_nearest_miss():
    least = RunningMin("exclusive_use", 5.0)
    least.note(0.4, 1.0, ("robot1", "robot2"), {"room": 0})
    least.note(0.2, 2.0, ("robot3", "robot4"), {"room": 1})
    verdict = least.verdict(runs=1)
    assert (verdict.violated, verdict.violated_at, verdict.who) == (False, None, ())
    assert verdict.evidence == {"room": 1, "runs": 1}
