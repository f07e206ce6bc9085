from __future__ import annotations

import pytest

from mrta_falsify.core.candidate import Dimension


@pytest.mark.parametrize(
    ("name", "options", "value", "told"),
    [
        ("trolley_2.active", ("True", "False"), 0.0, True),
        ("bed_1.yaw", ("0 deg", "90 deg"), 1.0, "90 deg"),
        ("radio.links", ("[planner]", "[states]"), 1.0, "[states]"),
        ("tasks[0][2]", ("3", "'lift'"), 0.0, 3),
        ("tasks[0][2]", ("3", "'101'"), 1.0, "101"),
        ("tasks[0][2]", (), 1.0, 1),
        ("tasks[0][2]", (), None, None),
    ],
)
def test_a_choice_is_told_by_its_option(name, options, value, told):
    dimension = Dimension(name=name, kind="choice", choices=2, options=options)
    found = dimension.told(value)
    assert found == told
    assert type(found) is type(told)
