from __future__ import annotations

import sys

import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.config import (
    LAYERS,
    Choice,
    StackConfig,
    apply_setting,
    decode_config,
    default_engine,
    read_config,
)
from mrta_falsify.core.errors import ConfigError, InputError, UnknownNameError


def test_the_layers_are_the_fields_that_hold_a_choice():
    assert set(LAYERS) == {
        "allocator", "queue_policy", "priority_rule", "waypoint_generator", "planner",
        "costmap", "controller", "human_model", "engine",
    }  # fmt: skip


def test_an_empty_file_is_the_default_stack(tmp_path):
    (tmp_path / "stack.yaml").write_text("")
    assert read_config(tmp_path / "stack.yaml") == StackConfig()


def test_a_layer_is_a_name_or_options_or_both():
    config = decode_config(
        {"planner": "ompl", "costmap": {"resolution": 0.1}, "engine": {"name": "e", "a": 1}},
        where="stack.yaml",
    )
    assert config.planner == Choice("ompl")
    assert config.costmap == Choice("layered", {"resolution": 0.1})
    assert config.engine == Choice("e", {"a": 1})


def test_what_encode_writes_decode_reads():
    config = apply_setting(apply_setting(StackConfig(), "planner=ompl"), "planner.seed=3")
    assert decode_config(codec.encode(config), where="x") == config


def test_settings_apply_in_order_and_keep_other_options():
    config = StackConfig()
    for setting in ("planner=ompl", "planner.range=2.0", "planner.seed=3", "control_rate=50"):
        config = apply_setting(config, setting)
    assert config.planner == Choice("ompl", {"range": 2.0, "seed": 3})
    assert config.control_rate == 50


def test_choosing_an_implementation_drops_the_options_of_the_other():
    config = apply_setting(apply_setting(StackConfig(), "planner.a=1"), "planner=ompl")
    assert config.planner == Choice("ompl")


def test_defects_are_sorted_and_unique():
    config = apply_setting(
        StackConfig(), "defects=[humans_unseen_beyond_two, fourth_waiter_dropped]"
    )
    assert config.defects == ("fourth_waiter_dropped", "humans_unseen_beyond_two")
    assert config.has("fourth_waiter_dropped")
    assert not config.has("same_room_twice_stalls")


@pytest.mark.parametrize(
    ("setting", "kind", "message"),
    [
        ("planer=astar", UnknownNameError, "unknown layer 'planer'; did you mean 'planner'?"),
        ("planner", ConfigError, "it must read layer=NAME or layer.option=VALUE"),
        ("=x", ConfigError, "it must read layer=NAME"),
        ("planner=[", ConfigError, "is not valid YAML"),
        ("control_rate=1000", InputError, "control_rate is 1000 Hz; it must be <= 100"),
        ("control_rate.x=1", ConfigError, "control_rate has no options"),
        ("defects=[sloth]", UnknownNameError, "unknown defect 'sloth'"),
    ],
)
def test_a_wrong_setting_says_what_is_wrong(setting, kind, message):
    with pytest.raises(kind) as caught:
        apply_setting(StackConfig(), setting)
    assert message in str(caught.value)


def test_a_layer_with_a_number_for_a_name_is_refused():
    with pytest.raises(ConfigError, match=r"stack\.yaml: planner is 3; it must be a name"):
        decode_config({"planner": 3}, where="stack.yaml")


def test_a_typo_in_a_layer_names_the_nearest(tmp_path):
    path = tmp_path / "stack.yaml"
    path.write_text("contoller: cluster_cbf\n")
    with pytest.raises(InputError, match=r"contoller is not a known field; did you mean"):
        read_config(path)


def test_equal_configurations_have_equal_digests():
    assert StackConfig().digest() == StackConfig().digest()
    assert apply_setting(StackConfig(), "planner=ompl").digest() != StackConfig().digest()


def test_the_default_engine_is_mujoco_only_where_pybullet_is_not_installed(monkeypatch):
    assert default_engine() == StackConfig().engine.name
    monkeypatch.setitem(sys.modules, "pybullet", None)
    assert default_engine() == "mujoco"
