"""How a foreign stack is named: on the command line, in YAML, in journals."""

from __future__ import annotations

import re
import sys

import pytest

from mrta_falsify.campaigns import code_digest as digests
from mrta_falsify.commands.stacks import load_stack
from mrta_falsify.core.config import read_config
from mrta_falsify.core.errors import ConfigError, InputError


def test_a_command_is_split_as_a_shell_would(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stack = load_stack(f"exec:{sys.executable} 'my stack.py' --fast").stack
    assert stack.command == (sys.executable, "my stack.py", "--fast")
    assert stack.folder == str(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("exec:", "there is no command"),
        ("exec:'", "cannot be split: No closing quotation"),
        ("exec:no-such-program", "there is no program 'no-such-program' in"),
        ("exec:./no-such-program", "there is no program './no-such-program' in"),
    ],
)
def test_a_command_that_cannot_be_is_refused_before_anything_runs(text, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_stack(text)


def test_paths_in_a_file_are_relative_to_it(tmp_path):
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "my_stack").touch()
    for text in ("stack: exec:./my_stack", "stack: {command: [./my_stack]}"):
        (folder / "stack.yaml").write_text(text)
        assert read_config(folder / "stack.yaml").stack.folder == str(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stack: {command: []}", "stack.command is empty; it must name a program"),
        ("stack: {comand: [a]}", "did you mean 'command'?"),
        ("stack: {command: [sh], branch: later}", "stack.branch is 'later'; it must be one of"),
        ("stack: {command: [sh], tick_limit: 0}", "stack.tick_limit is 0.0 s; it must be > 0"),
        ("stack: ./my_stack", "stack: './my_stack' must read exec:CMD"),
        ("stack: {command: [sh], folder: nowhere}", "nowhere does not exist"),
    ],
)
def test_a_file_that_is_wrong_says_what_and_what_is_allowed(tmp_path, text, message):
    (tmp_path / "stack.yaml").write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        read_config(tmp_path / "stack.yaml")


@pytest.mark.parametrize("part", ["stack", "allocator"])
def test_answers_of_a_changed_program_are_not_taken_for_those_of_the_old_one(
    part, tmp_path, monkeypatch
):
    for name in ("my_stack.py", "helper.py"):
        (tmp_path / name).write_text("one = 1\n")
    monkeypatch.chdir(tmp_path)
    config = load_stack(settings=[f"{part}=exec:{sys.executable} my_stack.py"])
    before = digests.code_digest(config)
    assert digests.code_digest(config) == before
    (tmp_path / "helper.py").write_text("one = 2\n")
    assert digests.code_digest(config) != before


def test_options_of_the_stack_are_set_like_those_of_a_layer(tmp_path):
    (tmp_path / "stack.yaml").write_text(f"stack: exec:{sys.executable}")
    changed = load_stack(tmp_path / "stack.yaml", ["stack.branch=never", "stack.tick_limit=2"])
    assert (changed.stack.branch, changed.stack.tick_limit) == ("never", 2.0)
    with pytest.raises(ConfigError, match="there is no foreign stack"):
        load_stack(None, ["stack.branch=never"])
