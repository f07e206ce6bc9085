"""The command line and the Python face are the same: commands, options, defaults."""

from __future__ import annotations

import dataclasses
import inspect
import keyword
import subprocess
import sys
from pathlib import Path

import click
import pytest

import mrta_falsify as mf
from mrta_falsify.campaigns.settings import CampaignSettings, Limits, TrialSettings
from mrta_falsify.cli import main
from mrta_falsify.cli.group import COMMANDS
from mrta_falsify.cli.options import RUN_OPTIONS

#: what only a command line needs: how to print, and which of several functions is meant
ONLY_OPTIONS = {
    "campaign": {"dry_run", "resume", "trust"},  # estimate_cost, resume_campaign
    "check": {"everything", "scenarios"},
    "import": {"floor", "stack", "settings"},  # import_log
    "ci": {"fail_on", "opens"},
    "report": {"opens", "watch"},
}
#: what only Python needs
ONLY_PARAMETERS = {
    "run": {"keep_trace"},
    "check": {"scenario"},
    "report": {"refresh"},
}
#: for a shell, or for someone who looks on: Python has no use for them
OF_THE_SHELL = {"completion"}
NAMES = sorted(set(COMMANDS) - OF_THE_SHELL)
ANY = inspect.Parameter("any", inspect.Parameter.KEYWORD_ONLY)


def command(name: str) -> click.Command:
    return main.get_command(click.Context(main), name)


def python_name(name: str) -> str:
    return f"{name}_" if keyword.iskeyword(name) else name.replace("-", "_")


def function(name: str):
    return getattr(mf, python_name(name))


def parameters(name: str) -> dict[str, inspect.Parameter]:
    found = inspect.signature(function(name)).parameters
    return {key: one for key, one in found.items() if not key.startswith("on_")}


def test_every_command_is_a_function_and_every_function_a_command():
    assert {python_name(name) for name in NAMES} == set(mf.VERBS)
    assert main.list_commands(click.Context(main)) == sorted(COMMANDS)


@pytest.mark.parametrize("name", NAMES)
def test_a_command_and_its_function_have_the_same_options(name):
    shown = (p for p in command(name).params if not getattr(p, "hidden", False))
    options = {param.name for param in shown} - {"style"}
    known = set(parameters(name))
    assert options - known == ONLY_OPTIONS.get(name, set())
    assert known - options == ONLY_PARAMETERS.get(name, set())


@pytest.mark.parametrize("name", NAMES)
def test_a_command_and_its_function_have_the_same_defaults(name):
    context = command(name).make_context(name, [], resilient_parsing=True)
    known = parameters(name)
    for param in command(name).params:
        if param.required or known.get(param.name, ANY).default is ANY.default:
            continue
        value = context.params[param.name]
        if isinstance(value, Path):
            value = str(value)
        assert value == known[param.name].default, param.name


def test_what_may_change_when_a_campaign_is_resumed_is_what_its_function_takes():
    resumed = inspect.signature(mf.resume_campaign).parameters
    options = {param.name for param in command("campaign").params}
    assert RUN_OPTIONS & options == {name for name in resumed if not name.startswith("on_")} - {
        "directory"
    }


def test_the_options_of_a_campaign_come_from_its_settings():
    params = {param.name: param for param in command("campaign").params}
    for settings in (TrialSettings, CampaignSettings, Limits):
        for field in dataclasses.fields(settings):
            if "text" in field.metadata:
                assert params.pop(field.name).help == field.metadata["text"]
    rest = {"scenario", "output", "resume", "workers", "executor", "stack", "settings", "specs"}
    assert set(params) == rest | {
        "against",
        "then",
        "confirm",
        "params",
        "dry_run",
        "style",
        "trust",
        "wall_clock",
    }


def test_a_line_of_the_list_of_commands_fits_80_columns():
    longest = max(map(len, COMMANDS))
    for name, listed in COMMANDS.items():
        assert longest + 4 + len(listed.summary) <= 80, name


def test_help_imports_neither_numpy_nor_rich():
    program = (
        "import sys; from mrta_falsify.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({'numpy', 'rich', 'yaml'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
