"""The table of faults follows the code."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.faults.table import read_faults

TREE = Path(__file__).resolve().parents[2]
FAULTS = read_faults()
PACKAGES = ("core", "stack", "specs", "campaigns", "analysis", "commands", "cli")
FOLDERS = (
    *(f"mrta_falsify/{package}" for package in PACKAGES),
    *("simulator_interface", "scenic_worlds", "samplers", "reports"),
)


def test_there_are_40_faults_of_different_names():
    assert len(FAULTS) == len({fault.name for fault in FAULTS}) == 40


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_package_has_a_fault(folder):
    assert any(fault.file.startswith(f"{folder}/") for fault in FAULTS)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_has_one_place_and_tests_that_exist(fault):
    assert fault.count(TREE) == 1
    for test in fault.tests:
        file, _, node = test.partition("::")
        assert f"def {node.partition('[')[0]}" in (TREE / file).read_text()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_no_syntax_error(fault):
    ast.parse(fault.text(TREE))
