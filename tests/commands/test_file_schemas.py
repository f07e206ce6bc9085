"""Every file of these kinds in the repository is valid by its schema, and mistakes are not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from mrta_falsify.commands.file_schemas import file_schemas, write_schemas
from mrta_falsify.commands.stacks import check_stack
from mrta_falsify.core.config import decode_config
from mrta_falsify.core.errors import InputError

ROOT = Path(__file__).parents[2]
OLD = ROOT / "tests" / "recorded" / "campaigns"
FOLDERS = ("docs", "examples", "experiments", "mrta_falsify", "scenic_worlds", "tests")


def kind_of(path: Path, data: Any) -> str:
    """Say which schema a file is for, empty: none."""
    if path.name.endswith("stack.yaml"):
        return "stack"
    if path.name == "mrta-falsify.yaml":
        return "project"
    if not isinstance(data, dict):
        return ""
    if "tasks_stream" in data:
        return "tasks"
    if {"bounds", "schema", "robots"} <= set(data):
        return "world"
    if path.suffix == ".yaml" and isinstance(data.get("rooms"), list):
        return "floor"
    return ""


def examples() -> list[tuple[str, Path, Any]]:
    found = []
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            is_old = OLD in path.parents  # names components that are gone
            if path.suffix in (".yaml", ".json") and not is_old:
                text = path.read_text(encoding="utf-8")
                try:
                    data = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
                except (yaml.YAMLError, ValueError):
                    continue  # broken on purpose
                kind = kind_of(path, data)
                if kind:
                    found.append((kind, path, data))
    return found


@pytest.fixture(scope="module")
def validators() -> dict[str, jsonschema.Draft202012Validator]:
    made = {}
    for name, schema in file_schemas().items():
        jsonschema.Draft202012Validator.check_schema(schema)
        made[name] = jsonschema.Draft202012Validator(schema)
    return made


def test_every_example_is_valid(validators):
    found = examples()
    for kind, path, data in found:
        errors = [f"{e.json_path}: {e.message[:200]}" for e in validators[kind].iter_errors(data)]
        assert not errors, f"{path}: {errors}"
    assert {kind for kind, _, _ in found} == set(validators)


STACKS = [
    None,
    {},
    {"planner": "ompl"},
    {"planner": {"resolution": 0.1}},
    {"planner": {"name": "ompl", "iterations": 500}},
    {"planner": {"name": "astar", "options": {"resolution": 0.1}}},
    {"planner": "exec:./plan --fast"},
    {"planner": "my_module:Mine"},
    {"defects": ["wrong_row"]},
    {"stack": "exec:./stack"},
    {"stack": {"command": ["./stack"], "tick_limit": 2.0}},
    {"control_rate": 20},
]
NO_STACKS = [
    {"plannner": "astar"},
    {"planner": "unknown"},
    {"planner": {"resolution": -1.0}},
    {"planner": {"name": "ompl", "resolutoin": 0.1}},
    {"planner": {"name": "astar", "options": {"resolutoin": 0.1}}},
    {"planner": 3},
    {"control_rate": 1000},
    {"defects": "wrong_row"},
    {"stack": "./stack"},
    {"stack": {"command": "./stack"}},
]


@pytest.mark.parametrize("data", STACKS, ids=str)
def test_short_and_long_forms_of_a_stack_are_valid(data, validators):
    validators["stack"].validate(data)


@pytest.mark.parametrize("data", NO_STACKS, ids=str)
def test_mistakes_in_a_stack_are_not(data, validators):
    assert not validators["stack"].is_valid(data)
    with pytest.raises(InputError):
        check_stack(decode_config(data, where="test", folder=ROOT), where="test")


def test_short_forms_of_a_project_are_valid(validators):
    data = {"scenarios": {"ward.scenic": None}, "stacks": {"ours": "stack.yaml"}}
    validators["project"].validate(data)
    assert not validators["project"].is_valid({"scenarios": {"ward.scenic": {"budgett": 3}}})


def test_files_are_written_and_replaced(tmp_path):
    paths = write_schemas(tmp_path / "made" / "here")
    assert [path.name for path in paths] == [
        f"{name}.schema.json" for name in sorted(file_schemas())
    ]
    before = [path.read_bytes() for path in paths]
    assert [path.read_bytes() for path in write_schemas(tmp_path / "made" / "here")] == before
