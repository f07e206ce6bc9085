"""One source for commands, options and exit codes: help, JSON, the page and completion agree."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mrta_falsify.cli.exits import MEANINGS
from mrta_falsify.cli.group import COMMANDS, described
from scenic_worlds.shipped import scenario_names

PAGE = (Path(__file__).parents[2] / "docs" / "commands.md").read_text()
COMMAND_LINE = json.loads(json.dumps(described(), default=str))


def test_the_page_of_commands_has_a_section_for_every_command_and_no_other():
    headings = re.findall(r"^## ([a-z][a-z, -]*)$", PAGE, re.MULTILINE)
    assert {name for heading in headings for name in heading.split(", ")} == set(COMMANDS)


def test_the_page_and_the_commands_say_the_same_of_exit_codes():
    rows = dict(re.findall(r"^\| (\d+) \| (.*) \|$", PAGE, re.MULTILINE))
    assert set(rows) == set(COMMAND_LINE["exit_codes"])
    for code, text in MEANINGS.items():
        assert rows[str(int(code))].startswith(text), code
    for code, word in (("1", "violated"), ("3", "failed")):
        told = {name: getattr(listed, word) for name, listed in COMMANDS.items()}
        for name, text in told.items():
            assert (f"`{name}`" in rows[code]) == bool(text), (code, name)
            assert text in rows[code]
    may_fail = {name for name, listed in COMMANDS.items() if listed.violated}
    always = set(re.findall(r"`([a-z-]+)`", rows["0"]))
    assert always == set(COMMANDS) - may_fail - {"doctor"}


def test_the_whole_command_line_is_one_json_object(cli):
    result = cli("--help-json")
    assert result.exit_code == 0
    told = json.loads(result.stdout)
    assert sorted(told["commands"]) == sorted(COMMANDS)
    campaign = told["commands"]["campaign"]
    options = {option["name"]: option for option in campaign["params"]}
    assert options["budget"]["default"] == 100
    assert options["budget"]["type"]["min"] == 1
    assert options["seed"]["default"] == 0
    assert options["tick_limit"]["type"]["min_open"]
    assert options["mode"]["type"]["choices"] == ["repair", "exact"]
    assert options["specs"]["multiple"]
    assert campaign["exit_codes"]["1"] == "a violation was found"


def test_the_help_of_a_command_says_what_its_exit_codes_mean(cli):
    assert "Exit code 1: digests differ." in cli("replay", "--help").stdout
    assert "Exit code" not in cli("list", "--help").stdout


def completed(*words: str) -> set[str]:
    """What a shell is told to offer for the last of the words."""
    env = {
        "_MRTA_FALSIFY_COMPLETE": "bash_complete",
        "COMP_WORDS": "\n".join(("mrta-falsify", *words)),
        "COMP_CWORD": str(len(words)),
    }
    done = subprocess.run(
        [sys.executable, "-c", "from mrta_falsify.cli import main; main()"],
        capture_output=True, text=True, check=True, env=os.environ | env,
    )  # fmt: skip
    return set(done.stdout.split())


def test_a_shell_completes_commands_options_and_names():
    assert {"plain,campaign", "plain,certify"} <= completed("c")
    assert completed("campaign", "--until") == {"plain,--until-saturated"}
    assert {f"plain,{name}" for name in scenario_names()} <= completed("check", "")
    assert "plain,halton" in completed("campaign", "bookshelf", "--sampler", "ha")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_script(cli, shell):
    result = cli("completion", shell)
    assert result.exit_code == 0
    assert f"_MRTA_FALSIFY_COMPLETE={shell}_complete" in result.stdout
