"""A week with the tool, from the first failure to the issue, by the commands that a team types."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from mrta_falsify.cli import main
from scenic_worlds.writing import write_program
from tests.external import lane_worlds

HERE = Path(__file__).parent
SPECS = ["no_deadlock", "all_tasks_done"]


def git(folder, *words):
    identity = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    command = ["git", *identity, "-C", str(folder), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


class Team:
    """A repository with a stack, and what is typed in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def commit(self, subject: str, **constants: float) -> None:
        path = self.folder / "stack.py"
        lines = path.read_text().splitlines(keepends=True)
        for name, value in constants.items():
            (at,) = [i for i, line in enumerate(lines) if line.startswith(f"{name} = ")]
            comment = lines[at].partition("  #")[2]
            lines[at] = f"{name} = {value}  #{comment}"
        path.write_text("".join(lines))
        git(self.folder, "add", ".")
        git(self.folder, "commit", "--quiet", "--allow-empty", "-m", subject)

    def call(self, *args: object, code: int) -> dict:
        done = CliRunner().invoke(main, [*map(str, args), "--format", "json"])
        assert done.exit_code == code, done.output
        return json.loads(done.stdout)

    def pytest(self, directory: str) -> tuple[int, str]:
        plugin = ("-p", "mrta_falsify.pytest_plugin", "-p", "no:randomly", "-p", "no:xdist")
        command = [sys.executable, "-m", "pytest", *plugin, f"--mrta-corpus={directory}"]
        done = subprocess.run(
            [*command, "--mrta-stack=stack.yaml", "--mrta-jittered=0", "-m", "mrta_corpus"],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": str(lane_worlds.ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout + done.stderr


@pytest.fixture
def team(tmp_path, monkeypatch):
    """On the first morning: a stack that waits for who is ahead, a scenario, a project file."""
    folder = tmp_path / "fleet"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(lane_worlds, "WIDTH", 3.0)
    write_program(lane_worlds.lane_world(), folder / "hall.scenic")
    program = (folder / "hall.scenic").read_text()
    drawn = program.replace("at (4.5, 1.5,", "at (Range(4.3, 4.7), 1.5,")
    assert drawn != program
    (folder / "hall.scenic").write_text(drawn)
    (folder / "stack.py").write_text((HERE / "week_stack.py").read_text())
    stack = {"command": [sys.executable, "stack.py"], "env": {"PYTHONPATH": str(lane_worlds.ROOT)}}
    (folder / "stack.yaml").write_text(yaml.safe_dump({"stack": stack, "engine": "kinematic"}))
    scenario = {"budget": 1, "specs": SPECS, "sampler": "random", "jittered": 0, "verify": 0}
    project = {"scenarios": {"hall.scenic": scenario}, "stacks": {"ours": "stack.yaml"}}
    (folder / "mrta-falsify.yaml").write_text(yaml.safe_dump(project))
    (folder / ".gitignore").write_text(".mrta-falsify\nruns\n")
    git(folder, "init", "--quiet")
    team = Team(folder)
    team.commit("Robots wait for who is ahead")
    return team


@pytest.mark.long
def test_a_week(team):
    # Day 1: a campaign finds a deadlock; `ci` knows it from now on, and runs nothing twice.
    specs = [word for spec in SPECS for word in ("--spec", spec)]
    quick = ("--budget", 1, "--sampler", "random", "--verify", 0, "--workers", 1)
    first = team.call(
        "campaign", "hall.scenic", "-o", "runs/first", "--stack", "stack.yaml",
        *quick, *specs, code=1,
    )  # fmt: skip
    assert [mode["signature"].partition("/")[0] for mode in first["modes"]] == ["no_deadlock"]
    monday = team.call("ci", "--trust", "--workers", 1, code=1)
    assert (monday["new"], monday["ongoing"], monday["resolved"]) == (1, 0, 0)
    again = team.call("ci", "--trust", "--workers", 1, code=1)
    assert (again["new"], again["ongoing"], again["cells"][0]["trials"]) == (0, 1, 0)

    # Day 2: the stack has changed. One is resolved, one is new.
    team.commit("Say what the stack is for")
    team.commit("Robots keep to the right", SIDE=0.7)
    team.commit("Robots drive more carefully", SPEED=0.08)
    team.commit("Say so")
    tuesday = team.call("ci", "--trust", "--workers", 1, "--junit", "ci.xml", code=1)
    assert (tuesday["new"], tuesday["resolved"], tuesday["ongoing"]) == (1, 1, 0)
    assert tuesday["cells"][0]["changed"] == ["code"]
    fresh = tuesday["changes"][0]
    assert fresh["signature"] == "all_tasks_done"
    assert "new: Not all tasks were delivered" in Path("ci.xml").read_text()
    directory, trial = fresh["example"]["directory"], fresh["example"]["id"]

    # Which commit brought it?
    team.folder.joinpath("runs", "is_good.sh").write_text(
        f"""#!/bin/sh
{sys.executable} -m mrta_falsify corpus {directory} --only {trial} \\
    --stack stack.yaml --perturbed 0 --workers 1
code=$?
[ $code -le 1 ] && exit $code
exit 125
"""
    )
    git(team.folder, "bisect", "start", "HEAD", "HEAD~4")
    found = git(team.folder, "bisect", "run", "sh", "runs/is_good.sh")
    assert "Robots drive more carefully" in found.partition("is the first bad commit")[2]
    git(team.folder, "bisect", "reset")
    assert git(team.folder, "status", "--porcelain") == "?? ci.xml"

    # Whoever is responsible gets an issue.
    issue = team.call("issue", directory, trial, "-o", "runs/issue", code=0)
    text = Path(issue["text"]).read_text()
    assert text.startswith("# Not all tasks were delivered")
    assert "new Robot with name 'robot2'" in text
    names = {str(Path(file).relative_to("runs/issue")) for file in issue["files"]}
    assert {
        "world.json", "world.scenic", "stack.yaml", "run.png", "run.gif", "nav2/map.yaml",
        "nav2/goals.yaml", "mrta-sim/testcase.json", "open-rmf/hall.building.yaml",
        "open-rmf/dispatch.sh",
    } <= names  # fmt: skip

    # Day 3: it is mended, and the plug-in keeps it so.
    code, said = team.pytest(directory)
    assert code == 1, said
    assert "still failing: Not all tasks were delivered" in said
    team.commit("Robots drive as before", SPEED=0.5)
    code, said = team.pytest(directory)
    assert code == 0, said
    friday = team.call("ci", "--trust", "--workers", 1, code=0)
    assert (friday["new"], friday["resolved"], friday["at_rest"]) == (0, 1, 1)
