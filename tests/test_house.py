"""The house itself: lazy imports, public names, floors, and files that must stay true."""

from __future__ import annotations

import ast
import functools
import itertools
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import mrta_falsify as mf
from mrta_falsify.core import registry
from tests.conftest import HERE, PARTS

ROOT = Path(__file__).parent.parent
HEAVY = ("pybullet", "scenic", "matplotlib", "ompl", "osqp", "numba", "pandas", "cv2")


def _loaded_after(statement: str) -> set[str]:
    program = f"{statement}\nimport sys, json; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return set(json.loads(done.stdout))


@pytest.mark.parametrize(
    "statement",
    [
        "import mrta_falsify",
        "import mrta_falsify.core.world, mrta_falsify.core.trace, mrta_falsify.core.registry",
        "import mrta_falsify.cli",
        "import samplers.random",
    ],
)
def test_importing_a_lower_floor_runs_no_upper_one_and_no_heavy_library(statement):
    loaded = _loaded_after(statement)
    assert loaded.isdisjoint(HEAVY)
    assert loaded.isdisjoint(
        {"mrta_falsify.commands.run", "mrta_falsify.trial", "simulator_interface"}
    )


def test_every_public_name_resolves():
    missing = [name for name in mf.__all__ if not hasattr(mf, name)]
    assert missing == []
    assert set(dir(mf)) == set(mf.__all__)


def test_an_unknown_public_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = mf.nonsense


def test_every_entry_point_group_is_an_extension_point():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = {name.removeprefix("mrta_falsify.") for name in project["entry-points"]} - {
        "pytest11",
        "defect",
    }
    assert groups <= set(registry.EXTENSION_POINTS)


def test_the_constraints_file_pins_every_dependency_by_name_and_version_only():
    lines = (ROOT / "constraints.txt").read_text().split()
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.+!]+", line) for line in lines)
    pinned = {_normal(line.partition("==")[0]) for line in lines}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = itertools.chain.from_iterable(project["optional-dependencies"].values())
    wanted = [*project["dependencies"], *extras]
    names = {_normal(re.match(r"[A-Za-z0-9._-]+", line)[0]) for line in wanted}
    assert names - pinned == set()


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _source_files() -> list[Path]:
    folders = ("mrta_falsify", "scenic_worlds", "simulator_interface", "samplers", "reports")
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def test_scenic_and_physics_stay_behind_their_doors():
    for path in _source_files():
        top = path.relative_to(ROOT).parts[0]
        for name in _imported(path):
            if name in ("pybullet", "mujoco"):
                assert top == "simulator_interface", path
            if name == "scenic":
                assert top in ("simulator_interface", "scenic_worlds"), path


def test_numba_stays_behind_its_door():
    users = [path for path in _source_files() if "numba" in _imported(path)]
    assert [str(path.relative_to(ROOT)) for path in users] == ["mrta_falsify/core/compiled.py"]


def test_parts_of_the_long_tests_name_what_is_there():
    places = [place for part in PARTS for place in part]
    assert [place for place in places if not (HERE / place).exists()] == []


def test_nothing_reads_a_pickle_and_nothing_uses_pyplot():
    for path in _source_files():
        assert "pickle" not in _imported(path), path
        assert "matplotlib.pyplot" not in path.read_text(), path


@functools.cache
def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.partition(".")[0])
    return names


def _pages() -> list[Path]:
    patterns = ("*.md", "docs/**/*.md", "examples/**/*.md")
    return sorted((page for pattern in patterns for page in ROOT.glob(pattern)), key=str)


def test_every_place_that_the_architecture_names_exists():
    text = (ROOT / "ARCHITECTURE.md").read_text()
    folders = "mrta_falsify|simulator_interface|scenic_worlds|samplers|reports|docs|tests"
    paths = re.findall(rf"`((?:{folders})/[\w/.]+)`", text)
    assert len(paths) > 30
    assert [path for path in paths if not (ROOT / path).exists()] == []
    names = re.findall(r"`(\w+)` (?:in|\()\s?`([\w/]+\.py)`", text)
    assert len(names) > 5
    missing = [
        (name, path)
        for name, path in names
        if (ROOT / path).is_file() and not re.search(rf"\b{name}\b", (ROOT / path).read_text())
    ]
    assert missing == []


@pytest.mark.parametrize("page", _pages())
def test_links_between_documents_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), target
