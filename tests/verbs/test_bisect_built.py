"""Stacks that are built from their sources, at each commit in its own worktree."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.verbs.bisect import bisecting, moved_stack
from mrta_falsify.verbs.bisect.bisecting import CommitRuns, bisect_failures
from mrta_falsify.verbs.bisect.processes import failed_build, run_to_end
from mrta_falsify.verbs.bisect.repository import Repository
from tests.verbs.test_bisect import git

#: commits, the first bad one, one that is not built: the only middle, so that it is always tried
LENGTH, CULPRIT, UNBUILT = 9, 6, 4
MAKE = 'mkdir -p build && sed s/SOURCE/BUILT/ source > build/stack && echo "a warning"'
FAIL = "echo first; echo second >&2; echo third >&2; echo fourth >&2; exit 7"
BUILD = "sh './make it.sh'"


@pytest.fixture
def sources(tmp_path, monkeypatch):
    """Commits of a stack whose program is made by a script; the last one is built already."""
    folder = tmp_path / "fleet"
    folder.mkdir()
    git(folder, "init", "--quiet")
    (folder / ".gitignore").write_text("build\n")
    for number in range(LENGTH):
        (folder / "source").write_text(f"SOURCE {number}\n")
        (folder / "make it.sh").write_text(FAIL if number == UNBUILT else MAKE)
        git(folder, "add", ".")
        git(folder, "commit", "--quiet", "-m", f"change {number}")
    subprocess.run(["sh", "make it.sh"], cwd=folder, check=True)
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def ran(monkeypatch):
    """Numbers of the commits that were run: those since the culprit fail. Nothing is simulated."""
    numbers = []

    def run(*words, **_):
        stack = yaml.safe_load(Path(words[words.index("--stack") + 1]).read_text())["stack"]
        built, number = Path(stack["command"][1]).read_text().split()
        assert built == "BUILT"
        numbers.append(int(number))
        now = "no_deadlock/2:a" if int(number) >= CULPRIT else ""
        row = {"fate": "fixed", "violated": [], "signature_now": now, "jittered": 0}
        return 0, json.dumps({"failures": [row]}), ""

    monkeypatch.setattr(bisecting, "_command", run)
    return numbers


@pytest.fixture
def bisected(campaign, sources, ran):
    """Bisects with a build; what each commit gave comes by its subject."""

    def search(build=BUILD, program="build/stack", folder=sources, *, stops=False):
        said: dict[str, CommitRuns] = {}

        def on_commit(commit, runs):
            if stops:
                raise KeyboardInterrupt
            said[Repository(sources).subject(commit)] = runs

        stack = StackConfig(
            stack=ExternalStack(command=(sys.executable, program), folder=str(folder)),
            engine=campaign.settings.trials.stack.engine,
        )
        (found,) = bisect_failures(
            campaign.directory,
            f"HEAD~{LENGTH - 1}..HEAD",
            build=build,
            stack=stack,
            jittered=0,
            on_commit=on_commit,
        )
        return found, said

    return search


def test_the_culprit_is_found_and_a_commit_that_is_not_built_is_left_out(bisected, sources):
    found, said = bisected()
    assert found.subject == f"change {CULPRIT}"
    assert found.skipped == 1
    why = said[f"change {UNBUILT}"].why
    assert why == "the build failed with exit code 7: second; third; fourth"
    assert git(sources, "status", "--porcelain") == ""
    assert (sources / "build" / "stack").read_text() == f"BUILT {LENGTH - 1}\n"


def test_a_folder_that_only_the_build_makes_names_the_repository(bisected, sources):
    found, _ = bisected(program="stack", folder=sources / "build")
    assert found.subject == f"change {CULPRIT}"


@pytest.mark.parametrize(
    ("build", "why"),
    [
        ("true", "tells nothing: the build has not made build/stack"),
        ("no-such-program --fast", "the build cannot be run: no-such-program: No such file"),
        ("false", "the build failed with exit code 1: it said nothing"),
        ("", "--build: there is no command"),
        ("make 'all", "--build: .* cannot be split: No closing quotation"),
    ],
)
def test_a_build_that_leads_to_nothing_is_refused(bisected, build, why):
    with pytest.raises(InputError, match=why):
        bisected(build)


@pytest.mark.parametrize(("build", "known"), [(BUILD, True), (f"{BUILD} again", False)])
def test_finished_commits_are_those_of_the_same_build(bisected, ran, build, known):
    with pytest.raises(KeyboardInterrupt, match="1 finished run"):
        bisected(stops=True)
    assert ran == [0]
    bisected(build)
    assert ran.count(0) == (1 if known else 2)


def test_it_is_built_in_the_folder_that_it_was_typed_in(bisected, sources, monkeypatch):
    (sources / "inner").mkdir()
    monkeypatch.chdir(sources / "inner")  # no commit has it: the top of the worktree
    assert bisected()[0].subject == f"change {CULPRIT}"


def test_a_link_out_of_the_repository_is_no_product_of_the_build(sources, tmp_path):
    (sources / "python").symlink_to(sys.executable)
    stack = ExternalStack(command=("./python", "source"), folder=str(sources))
    with Repository(sources).worktree("HEAD", tmp_path / "one") as place:
        config = StackConfig(stack=stack)
        found = moved_stack.moved(config, sources, place, is_built=True).stack
    assert found.command == (str(sources / "python"), str(place / "source"))


def test_what_a_build_has_started_ends_with_us(tmp_path):
    program = f"from pathlib import Path\nfrom {run_to_end.__module__} import run_to_end\n"
    program += "run_to_end(['sh', '-c', 'sleep 60 & echo $! > pid; wait'], folder=Path.cwd())"
    ours = subprocess.Popen([sys.executable, "-c", program], cwd=tmp_path, stderr=subprocess.PIPE)
    pid = tmp_path / "pid"
    while not pid.is_file() or not pid.read_text().strip():
        assert ours.poll() is None, ours.stderr.read()
        time.sleep(0.01)
    ours.send_signal(signal.SIGINT)
    ours.communicate()
    for _ in range(500):  # it was signalled; how soon it is gone is the system's business
        if not _is_running(int(pid.read_text())):
            return
        time.sleep(0.01)
    pytest.fail("what the build has started still runs")


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    return state != "Z"


def test_a_build_that_works_says_nothing(sources):
    assert failed_build(("sh", "make it.sh"), sources) == ""


def test_build_goes_with_bisect_only(campaign):
    done = CliRunner().invoke(main, ["corpus", str(campaign.directory), "--build", "make"])
    assert done.exit_code == 2
    assert "--build goes with --bisect GOOD..BAD only" in done.output
