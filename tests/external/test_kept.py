"""What a stack makes the harness keep counts as its memory."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core.fleet import no_intent
from simulator_interface.external.answers import Reader
from simulator_interface.external.process import Heavy, StackProcess
from simulator_interface.external.stack import POINT, ROW, _kept_of

READER = Reader(("r1", "r2"), 2)


def answer(**fields):
    message = {"type": "command", "tick": 0, "twist": [[0.0, 0.0, 0.0]] * 2, **fields}
    return READER.read(message, 0, 0.0)


def test_points_that_are_new_cost_and_the_same_again_do_not():
    said = answer(paths=[[0, [[0.0, 0.0], [1.0, 1.0]]]])
    before = no_intent(2)
    assert _kept_of(said, before, before) == 2 * POINT
    known = before.__class__(
        **{
            **{name: getattr(before, name) for name in before.__dataclass_fields__},
            "path": (np.array([[0.0, 0.0], [1.0, 1.0]]), before.path[1]),
        }
    )
    assert _kept_of(said, known, known) == 0


def test_events_and_waits_cost_with_their_text():
    said = answer(events=[{"kind": "x" * 100}, {"kind": "y"}])
    assert _kept_of(said, no_intent(2), no_intent(2)) == 2 * ROW + 2 * 101


def test_what_is_kept_is_weighed_with_the_processes(monkeypatch):
    process = StackProcess.__new__(StackProcess)
    process._program, process.kept = None, 0
    process.weigh()
    process.kept = 3 << 30
    with pytest.raises(Heavy, match=r"3\.0 of them in paths"):
        process.weigh()
