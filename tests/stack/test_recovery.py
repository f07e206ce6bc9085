"""Which stuck robots back up, and which have a reason to stay."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.stack.control.manoeuvres import BACK, CHOICE, GO, STAY
from mrta_falsify.stack.control.obstacles import People
from mrta_falsify.stack.control.recovery import LENGTH, STUCK_AFTER, back_up_where_stuck
from mrta_falsify.stack.control.state import ControllerState

NOBODY = People(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
POST = (0.32, 0.05)  # m, ahead of a robot at (0, 0) that looks east


def chosen(points=(POST,), others=(), people=NOBODY, *, kind=GO, stood=STUCK_AFTER, twist=0.0):
    """The choice of a robot at (0, 0) that looks east, after it stood for so many seconds."""
    pose = np.array([[0.0, 0.0, 0.0], *([x, y, 0.0] for x, y in others)])
    crew = ControllerState.fresh(pose, 0.0).crew
    crew["present"], crew["joint"] = True, True
    crew["twist"][:, 2] = twist
    choices = np.zeros(len(pose), dtype=CHOICE)
    choices["kind"] = [kind, *[STAY] * len(others)]
    seen = np.full((len(pose), 4, 2), np.inf)
    seen[0, : len(points)] = np.array(points).reshape(-1, 2)
    back_up_where_stuck(choices, crew, seen, people, 0.3, stood)
    return choices[0]


def test_a_robot_with_its_nose_at_a_post_backs_up_straight():
    choice = chosen()
    assert (choice["kind"], choice["reverse"]) == (BACK, True)
    assert choice["point"] == pytest.approx([-LENGTH, 0.0])


@pytest.mark.parametrize(
    "case",
    [
        {"stood": STUCK_AFTER - 0.1},
        {"kind": STAY},  # it waits, or is told to
        {"twist": 0.5},  # it turns on the spot
        {"points": ()},  # nothing is before it
        {"points": ((-0.32, 0.0),)},  # only behind it
        {"points": (POST, (-0.5, 0.0))},  # no room behind
        {"others": ((0.0, 1.0),)},
        {"people": People(np.array([[0.9, 0.0]]), np.zeros((1, 2)), np.array([0.25]))},
    ],
    ids=["soon", "waits", "turns", "free", "behind", "no room", "robot", "person"],
)
def test_a_robot_with_a_reason_to_stay_does_not_back_up(case):
    assert chosen(**case)["kind"] == case.get("kind", GO)
