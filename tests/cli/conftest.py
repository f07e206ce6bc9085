from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from mrta_falsify.cli import main
from mrta_falsify.core import codec
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.world import HumanSpec, RobotSpec, Task, World, write_world
from mrta_falsify.testing.wards import ward_layout


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Result]:
    """Runs a command in an empty directory, without colours, 100 columns wide."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("FORCE_COLOR", raising=False)

    def run(*args: str) -> Result:
        return CliRunner().invoke(main, list(args))

    return run


@pytest.fixture
def ward() -> World:
    """A small ward with two robots, one person and two tasks; quick to run."""
    layout = ward_layout(rooms=2)
    robots = tuple(
        RobotSpec(name=f"robot{i + 1}", pose=frozen_array([*room.point, -np.pi / 2]))
        for i, room in enumerate(layout.rooms)
    )
    return dataclasses.replace(
        layout,
        name="small_ward",
        robots=robots,
        humans=(HumanSpec(name="human1", route=frozen_array([[0.6, 0.6], [0.7, 0.6]])),),
        tasks=(
            Task(arrival=0.0, start=0, end=1, deadline=100.0),
            Task(arrival=1.0, start=1, end=0, deadline=150.0),
        ),
        horizon=120.0,
    )


@pytest.fixture
def ward_file(ward: World, tmp_path: Path) -> Path:
    path = tmp_path / "ward.json"
    write_world(ward, path)
    return path


@pytest.fixture
def edited(hall: World, tmp_path: Path) -> Callable[[Callable[[dict], None]], Path]:
    """Writes the hall as hall.json after ``edit`` has changed its JSON data in place."""

    def write(edit: Callable[[dict], None]) -> Path:
        data = codec.encode(hall)
        edit(data)
        path = tmp_path / "hall.json"
        path.write_text(json.dumps(data))
        return path

    return write
