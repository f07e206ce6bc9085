"""Certificates edited at random; the checker must refuse each.

A robot left out or put in, an edge turned round, a pose or goal moved by 0.3 m, a resource renamed,
times shifted, a trace changed. All digests are computed anew.
"""

from __future__ import annotations

import io
import json
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.analysis.certify import checker
from mrta_falsify.analysis.certify.certifying import REFUSALS

SHIFT = 0.3  # m or s
COLUMNS = ("time", "pose", "goal", "tasks_left")  # of a trace, that a certificate rests on

Data = dict[str, Any]
Edit = Callable[[Data, np.random.Generator], bool]


def any_of(rows: list[Any], random: np.random.Generator) -> Any:
    return rows[int(random.integers(len(rows)))]


def drop_member(data: Data, random: np.random.Generator) -> bool:
    data["members"].remove(any_of(data["members"], random))
    return True


def drop_edge(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    if not row["robots"]:
        return False
    row["robots"].remove(any_of(row["robots"], random))
    return True


def turn_edge(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    others = {one["name"]: one for one in data["members"]}
    ends = [name for name in row["robots"] if name in others]
    if not ends:
        return False
    end = any_of(ends, random)
    row["robots"].remove(end)
    if row["name"] not in others[end]["robots"]:
        others[end]["robots"].append(row["name"])
    return True


def add_edge(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    new = [one["name"] for one in (*data["members"], *data["resting"])]
    new = [name for name in new if name not in (*row["robots"], row["name"])]
    if not new:
        return False
    row["robots"].append(any_of(new, random))
    return True


def move_pose(data: Data, random: np.random.Generator) -> bool:
    row = any_of([*data["members"], *data["resting"]], random)
    angle = random.uniform(0.0, 2.0 * np.pi)
    x, y = row["pose"]
    row["pose"] = [x + SHIFT * np.cos(angle), y + SHIFT * np.sin(angle)]
    return True


def move_goal(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    row["goal"][int(random.integers(2))] += SHIFT * random.choice([-1.0, 1.0])
    return True


def rename_area(data: Data, random: np.random.Generator) -> bool:
    rows = [row for row in data["members"] if row["area"]]
    if not rows:
        return False
    any_of(rows, random)["area"] += "_2"
    return True


def rename_robot(data: Data, random: np.random.Generator) -> bool:
    any_of(data["members"], random)["name"] += "_2"
    return True


def swap_robots(data: Data, random: np.random.Generator) -> bool:
    if len(data["members"]) < 2:
        return False
    one, two = random.choice(len(data["members"]), 2, replace=False)
    rows = data["members"]
    rows[one]["name"], rows[two]["name"] = rows[two]["name"], rows[one]["name"]
    return True


def shift_time(data: Data, random: np.random.Generator) -> bool:
    data[any_of(["since", "until"], random)] += SHIFT * random.choice([-1.0, 1.0])
    return True


EDITS: tuple[Edit, ...] = (
    drop_member,
    drop_edge,
    turn_edge,
    add_edge,
    move_pose,
    move_goal,
    rename_area,
    rename_robot,
    swap_robots,
    shift_time,
)


def sealed_data(data: Data) -> Data:
    """Compute the digest of a certificate anew."""
    said = {key: value for key, value in data.items() if key not in ("digest", "version")}
    return data | {"digest": checker.digest(said)}


def is_refused(folder: Path, data: Data) -> bool:
    """Whether the checker refuses a certificate."""
    try:
        checker.accept(folder, sealed_data(data))
    except REFUSALS:
        return True
    return False


def edited(folder: Path, random: np.random.Generator) -> tuple[str, bool]:
    """Edit the certificate of a folder; say how, and whether it is refused."""
    while True:
        kind = int(random.integers(len(EDITS) + 1))
        data = json.loads((folder / "certificate.json").read_text())
        if kind == len(EDITS):
            return "move_trace", _refused_with_moved_trace(folder, data, random)
        if EDITS[kind](data, random):
            return EDITS[kind].__name__, is_refused(folder, data)


def _refused_with_moved_trace(folder: Path, data: Data, random: np.random.Generator) -> bool:
    """Move a member in the last second of the trace, and in the certificate with it."""
    with zipfile.ZipFile(folder / "trace.zip") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    table = json.loads(files["table.json"])
    row = any_of(data["members"], random)
    pose = np.load(io.BytesIO(files["pose.npy"]))
    last = round(1.0 / table["dt"])
    pose[-last:, table["robots"].index(row["name"]), 0] += SHIFT
    row["pose"][0] += SHIFT
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, pose)
    files["pose.npy"] = buffer.getvalue()
    data["read"] = sha256(b"".join(files[f"{name}.npy"] for name in COLUMNS)).hexdigest()
    with tempfile.TemporaryDirectory() as place:
        shutil.copy(folder / "world.json", place)
        with zipfile.ZipFile(Path(place, "trace.zip"), "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
        return is_refused(Path(place), data)
