from __future__ import annotations

import sys

import pytest

from mrta_falsify.commands.stacks import load_stack
from mrta_falsify.core.config import decode_config
from mrta_falsify.core.errors import InputError


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("ros_nodes", "simulator_interface.foreign.ros_nodes"),
        ("dds", "simulator_interface.foreign.dds"),
    ],
)
def test_an_adapter_gives_the_process_of_its_stack(name, module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stack = load_stack(f"{name}:nodes.yaml").stack
    assert stack is not None
    assert stack.command == (sys.executable, "-m", module, "nodes.yaml")
    assert stack.folder == str(tmp_path)
    there = decode_config({"stack": f"{name}:nodes.yaml"}, where="stack.yaml", folder=tmp_path)
    assert there.stack == stack


def test_a_text_with_another_name_is_a_file(tmp_path):
    with pytest.raises(InputError, match=r"nobody:nodes\.yaml"):
        load_stack("nobody:nodes.yaml")


def test_nodes_need_a_file_and_the_bridge_needs_none():
    with pytest.raises(InputError, match="it must be a file with the nodes"):
        load_stack("ros_nodes:")
    stack = load_stack("dds:").stack
    assert stack is not None
    assert stack.command[1:] == ("-m", "simulator_interface.foreign.dds")
