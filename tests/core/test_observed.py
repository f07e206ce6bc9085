from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest

from mrta_falsify.core import trace as tracing
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.difference import first_difference
from mrta_falsify.core.fleet import Sensed, nothing_sensed
from mrta_falsify.core.observed import Observed, observed_in
from mrta_falsify.core.trace import Trace, read_trace, write_trace
from tests.conftest import scripted_trace


@dataclass
class Battery:
    number: int
    charge: Annotated[Array, Observed(("N",), 1.0, hashed=False, optional=True)]
    hits: Annotated[Array, Observed(("N", "A", 2), -1)]


def test_rows_stand_beside_their_fields_in_order():
    assert list(observed_in(Battery)) == ["charge", "hits"]
    assert not observed_in(Battery)["charge"].hashed


def test_what_nobody_measured_has_the_shape_and_type_of_its_row():
    charge, hits = (row.blank({"N": 3}) for row in observed_in(Battery).values())
    np.testing.assert_array_equal(charge, [1.0, 1.0, 1.0])
    assert hits.shape == (3, 0, 2)
    assert hits.dtype == np.int64


def test_an_engine_need_not_give_what_is_optional():
    sensed = nothing_sensed(2, people=1, rays=4)
    values = {f.name: getattr(sensed, f.name) for f in dataclasses.fields(Sensed)}
    assert Sensed(
        **{k: v for k, v in values.items() if k != "furniture_pose"}
    ).furniture_pose.shape == (0, 3)
    assert sensed.human_position.shape == (1, 2)
    assert sensed.contact.dtype == np.bool_
    assert np.isinf(sensed.gap_robot).all()


@pytest.fixture
def unhashed_goal(monkeypatch):
    """Record goals beside what is hashed."""
    others = tuple(name for name in tracing.COLUMNS if name != "goal")
    monkeypatch.setattr(tracing, "_HASHED", others)
    monkeypatch.setattr(tracing, "_OTHERS", ("goal",))
    monkeypatch.setattr(tracing, "_hashed_values", tracing._reader(others))
    monkeypatch.setattr(tracing, "_other_values", tracing._reader(("goal",)))


def test_a_value_that_is_not_hashed_is_kept_all_the_same(hall, hall_trace, unhashed_goal):
    kept = scripted_trace(hall, seconds=10.0)
    assert kept.digest != hall_trace.digest  # goals count there
    for name, column in hall_trace.columns.items():
        np.testing.assert_array_equal(kept.columns[name], column)


def _without(trace: Trace, name: str) -> Trace:
    columns = {key: column for key, column in trace.columns.items() if key != name}
    return dataclasses.replace(trace, columns=columns)


def test_traces_are_compared_by_the_columns_that_both_have(hall_trace):
    older = _without(hall_trace, "furniture_pose")
    assert first_difference(older, hall_trace) is None
    moved = np.array(hall_trace.columns["pose"])
    moved[7, 1, 0] += 0.5
    other = dataclasses.replace(older, columns={**older.columns, "pose": moved})
    found = first_difference(hall_trace, other)
    assert found is not None
    assert (found.tick, found.what, found.who) == (7, "pose", hall_trace.robots[1])


def test_a_file_may_lack_an_optional_column_only(hall_trace, tmp_path):
    write_trace(_without(hall_trace, "furniture_pose"), tmp_path / "older.zip")
    assert "furniture_pose" not in read_trace(tmp_path / "older.zip").columns
    write_trace(_without(hall_trace, "slack"), tmp_path / "damaged.zip")
    with pytest.raises(tracing.FormatError, match="column slack is missing"):
        read_trace(tmp_path / "damaged.zip")
