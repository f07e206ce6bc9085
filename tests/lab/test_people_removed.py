"""People who are taken out of a run on the way, on every engine."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.trace import Trace
from mrta_falsify.lab import Edit, Experiment, Lab


@pytest.mark.parametrize("engine", ["kinematic", "bullet", "mujoco"])
def test_a_person_is_there_until_it_is_removed_and_not_after(hall, engine, tmp_path):
    world = dataclasses.replace(hall, horizon=2.0)
    whole = Experiment(
        world=world,
        stack=StackConfig(engine=Choice(engine)),
        specs=("no_robot_robot_contact",),
        early_stop=False,
    )
    edited = dataclasses.replace(whole, edits=(Edit(at=1.0, without_people=(0,)),))
    lab, seen = Lab(), tmp_path / "seen"

    def keep(world, judged):
        trace: Trace = judged.outcome.trace
        np.save(seen, trace.columns["human_position"][:, 0])

    before = lab.judge(whole).outcome.trace.columns["human_position"][:, 0]
    result = lab.watch(edited, keep)
    after = np.load(f"{seen}.npy")
    assert result.status == "judged"
    removed = int(np.argmax(np.isnan(after).any(axis=1)))
    assert removed == 21  # the frame of 1.0 s shows the person for the last time
    assert np.array_equal(after[:removed], before[:removed])
    assert np.isnan(after[removed:]).all()
    assert np.isfinite(before).all()
