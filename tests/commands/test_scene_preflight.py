"""Samplers of a campaign look at the scenes that its trials will run."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.commands import scene_preflight
from mrta_falsify.commands.campaign import campaign
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.scene_preflight import ScenePreflight
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import DEMANDS
from mrta_falsify.core.seeding import stream
from mrta_falsify.lab.stored import stored_world
from mrta_falsify.preflight import preflight
from tests.quick_program import PROGRAM


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "quick.scenic"
    path.write_text(PROGRAM)
    return path


def test_a_scene_is_the_one_that_a_trial_would_run_and_always_the_same(program, tmp_path):
    settings = new_settings(program, output=tmp_path / "c").trials
    preflight, another = ScenePreflight(settings), ScenePreflight(settings)
    random = stream(0, "test/preflight")
    k = len(preflight._program.space)
    for _ in range(5):
        u = random.random(k)
        found, again = preflight(u), another(u)
        assert found is not None
        np.testing.assert_array_equal(found.u, again.u)
        np.testing.assert_array_equal(found.demands, again.demands)
        same = preflight(found.u)  # what was realised is valid as it is
        np.testing.assert_array_equal(same.u, found.u)
        np.testing.assert_array_equal(same.demands, found.demands)


def test_a_point_without_a_scene_has_no_demands(program, tmp_path):
    program.write_text(PROGRAM + "require False\n")
    settings = new_settings(program, output=tmp_path / "c").trials
    assert ScenePreflight(settings)(np.full(6, 0.5)) is None


def test_a_program_that_has_changed_is_an_error_and_no_missing_scene(program, tmp_path):
    settings = new_settings(program, output=tmp_path / "c").trials
    program.write_text(PROGRAM + "param horizon = 50\n")
    with pytest.raises(InputError, match="has changed"):
        ScenePreflight(settings)(np.full(6, 0.5))


def test_trials_of_a_campaign_run_what_was_looked_at(program, tmp_path, monkeypatch):
    looked_at = []
    plain = scene_preflight.preflight
    monkeypatch.setattr(
        scene_preflight, "preflight", lambda world: looked_at.append(plain(world)) or looked_at[-1]
    )
    result = campaign(
        program,
        tmp_path / "c",
        sampler="samplers.demanding:DemandingSampler",
        budget=2,
        executor="serial",
        jittered=0,
        settings=["engine=kinematic"],
        specs=["deadlines"],
    )
    assert len(result.campaign.records) == 2
    known = np.array(looked_at)
    assert len(known) > 4 * len(result.campaign.records)
    for record in result.campaign.records:
        demands = preflight(stored_world(result.campaign, record))
        assert demands.shape == (len(DEMANDS),)
        assert (np.abs(known - demands).max(axis=1) < 1e-9).any()
