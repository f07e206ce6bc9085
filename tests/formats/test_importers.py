from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.errors import ConfigError, InputError
from simulator_interface.formats.floor_yaml import floor_of_data, read_floor

ROOMS = {
    "walls": [{"polygon": [[0, 0], [8, 0], [8, 0.1], [0, 0.1]]}],
    "bounds": [0, 0, 8, 6],
    "rooms": [{"name": "ward", "point": [2, 3]}, {"name": "store", "point": [6, 3]}],
}


class Plan:
    """A stranger's files: anything whose name ends in ``.plan.yaml`` has the same two rooms."""

    @dataclass(frozen=True)
    class Options:
        """Nothing to choose."""

    endings = (".plan.yaml",)

    def __init__(self, options):
        del options

    def read(self, path: Path, rooms: Path | None = None, level: str | None = None):
        assert (rooms, level) == (None, "ground")
        return floor_of_data(ROOMS, path)


@pytest.fixture
def with_plan(monkeypatch):
    known = registry._entry_points("importer")
    own = {**known, "plan": f"{__name__}:Plan"}
    real = registry._entry_points
    monkeypatch.setattr(
        registry, "_entry_points", lambda point: own if point == "importer" else real(point)
    )


@pytest.mark.usefixtures("with_plan")
def test_an_importer_of_somebody_else_reads_files_of_its_ending(tmp_path):
    path = tmp_path / "House.PLAN.yaml"
    path.write_text("not: a floor")
    floor = read_floor(path, level="ground")
    assert [room.name for room in floor.rooms] == ["ward", "store"]


@pytest.mark.usefixtures("with_plan")
@pytest.mark.parametrize("name", ["a.yaml", "a.unknown", "plan.yaml"])
def test_other_files_are_read_as_before(tmp_path, name):
    (tmp_path / name).write_text("not: a floor")
    with pytest.raises(InputError, match="not"):
        read_floor(tmp_path / name)


@pytest.mark.parametrize("name", ["a.sdf", "a.yaml"])
def test_a_level_of_what_has_none_is_refused(tmp_path, name):
    (tmp_path / name).write_text("{}")
    with pytest.raises(ConfigError, match="is no building, so it has no level 'upper'"):
        read_floor(tmp_path / name, level="upper")
