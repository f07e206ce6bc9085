"""Which commit brought a failure: the search, the worktrees, stacks as of a commit."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import pytest

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.verbs.bisect import bisecting, moved_stack
from mrta_falsify.verbs.bisect.bisecting import CommitRuns, bisect_failures
from mrta_falsify.verbs.bisect.repository import Repository

LENGTH = 9  # commits


def git(folder, *words):
    identity = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    command = ["git", *identity, "-C", str(folder), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def repository(tmp_path):
    """Commits 0 to 8 of a stack; the number of each is in its file and its subject."""
    folder = tmp_path / "repository"
    folder.mkdir()
    git(folder, "init", "--quiet")
    for number in range(LENGTH):
        (folder / "stack.py").write_text(f"NUMBER = {number}\n")
        git(folder, "add", "stack.py")
        git(folder, "commit", "--quiet", "-m", f"change {number}")
    return Repository(folder.resolve())


@pytest.fixture
def bisected(campaign, repository, monkeypatch):
    """Bisects the campaign's failure; what each commit does is a function of its number."""

    def search(outcome, span=None, **options):
        asked = []

        def run(self, record, commit):
            number = int(self.repository.subject(commit).split()[1])
            asked.append(number)
            return outcome(number)

        monkeypatch.setattr(bisecting._Trial, "_run", run)
        command = (sys.executable, "stack.py")
        config = StackConfig(
            stack=ExternalStack(command=command, folder=str(repository.top)),
            engine=campaign.settings.trials.stack.engine,
        )
        span = span or f"HEAD~{LENGTH - 1}..HEAD"
        (found,) = bisect_failures(campaign.directory, span, stack=config, **options)
        return found, asked

    return search


@pytest.mark.parametrize("culprit", range(1, LENGTH))
def test_the_first_bad_commit_is_found_in_few_steps(bisected, culprit):
    found, asked = bisected(lambda number: CommitRuns(failed=3 * (number >= culprit), runs=3))
    assert found.subject == f"change {culprit}"
    assert len(asked) == len(set(asked)) == found.tried <= 6
    assert found.runs == 3 * found.tried
    assert (found.failed_at_good, found.failed_at_bad, found.skipped) == ("0 of 3", "3 of 3", 0)


def test_a_flaky_failure_counts_where_it_is_nearer_to_bad(bisected):
    failing = [0, 1, 0, 1, 0, 3, 4, 3, 4]
    found, _ = bisected(lambda number: CommitRuns(failed=failing[number], runs=5), jittered=4)
    assert found.subject == "change 5"


def test_commits_that_tell_nothing_are_left_out(bisected):
    def outcome(number):
        if number in (3, 5):
            return CommitRuns(why="the stack does not start")
        return CommitRuns(failed=int(number >= 7), runs=1)

    found, _ = bisected(outcome)
    assert found.subject == "change 7"


def test_where_they_hide_the_first_bad_one_all_candidates_are_named(bisected, repository):
    def outcome(number):
        if number in (4, 5):
            return CommitRuns(why="the stack does not start")
        return CommitRuns(failed=int(number >= 5), runs=1)

    found, _ = bisected(outcome)
    assert (found.commit, found.skipped) == ("", 2)
    subjects = {repository.subject(commit) for commit in found.candidates}
    assert subjects == {"change 4", "change 5", "change 6"}


@pytest.mark.parametrize(
    ("outcome", "span", "complaint"),
    [
        (CommitRuns(failed=1, runs=3), None, "fails in 1 of 3 runs at GOOD and in 1 of 3 at BAD"),
        (CommitRuns(why="it is broken"), None, r"GOOD \(.*\) tells nothing: it is broken"),
        (CommitRuns(), "HEAD..HEAD~2", "BAD does not come after GOOD"),
        (CommitRuns(), "HEAD..HEAD", "BAD does not come after GOOD"),
        (CommitRuns(), "nonsense..HEAD", "'nonsense' is no commit of"),
        (CommitRuns(), "HEAD~2", r"it must read GOOD\.\.BAD"),
        (CommitRuns(), "HEAD~2...HEAD", r"it must read GOOD\.\.BAD"),
    ],
)
def test_ends_that_allow_no_answer_are_refused(bisected, outcome, span, complaint):
    with pytest.raises(InputError, match=complaint):
        bisected(lambda number: outcome, span)


def test_finished_commits_are_kept_for_the_next_call(bisected):
    def interrupted(number):
        if number == 4:
            raise KeyboardInterrupt
        return CommitRuns(failed=int(number >= 2), runs=1)

    with pytest.raises(KeyboardInterrupt, match="2 finished runs"):
        bisected(interrupted)
    found, asked = bisected(lambda number: CommitRuns(failed=int(number >= 2), runs=1))
    assert found.subject == "change 2"
    assert not {0, LENGTH - 1} & set(asked)


def test_a_stack_of_shipped_layers_has_no_repository(campaign):
    with pytest.raises(InputError, match="no git repository holds the stack"):
        bisect_failures(campaign.directory, "a..b")


# --- worktrees -------------------------------------------------------------------------------


def test_a_worktree_has_the_files_of_its_commit_and_goes_on_ctrl_c(repository, tmp_path):
    place = tmp_path / "worktrees" / "one"

    def stopped():
        with repository.worktree("HEAD~6", place):
            assert (place / "stack.py").read_text() == "NUMBER = 2\n"
            assert (repository.top / "stack.py").read_text() == f"NUMBER = {LENGTH - 1}\n"
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert not place.exists()
    assert len(git(repository.top, "worktree", "list").splitlines()) == 1
    assert git(repository.top, "status", "--porcelain") == ""


def test_what_a_kill_left_behind_is_replaced(repository, tmp_path):
    place = tmp_path / "worktrees" / "one"
    git(repository.top, "worktree", "add", "--quiet", "--detach", str(place), "HEAD")
    with repository.worktree("HEAD~1", place):
        assert (place / "stack.py").read_text() == f"NUMBER = {LENGTH - 2}\n"
    assert len(git(repository.top, "worktree", "list").splitlines()) == 1


def test_files_of_a_command_come_from_the_commit_and_others_from_where_they_are(
    repository, tmp_path
):
    (repository.top / "python").write_text("not part of any commit")
    outside = tmp_path / "elsewhere.py"
    outside.write_text("")
    stack = ExternalStack(
        command=("./python", "stack.py", str(repository.top / "stack.py"), str(outside), "--fast"),
        folder=str(repository.top),
    )
    with repository.worktree("HEAD", tmp_path / "one") as place:
        found = moved_stack.moved(
            dataclasses.replace(StackConfig(), stack=stack), repository.top, place
        ).stack
        assert found.folder == str(place)
        assert found.command == (
            str(repository.top / "python"),
            str(place / "stack.py"),
            str(place / "stack.py"),
            str(outside),
            "--fast",
        )


@pytest.mark.parametrize(
    ("row", "failed", "runs"),
    [
        ({"signature_now": "no_deadlock/2:a", "copy_signatures": ["no_deadlock/1:b"]}, 2, 3),
        ({"signature_now": "no_deadlock/2:a"}, 1, 3),
        ({"signature_now": "deadlines", "copy_signatures": ["deadlines"] * 2}, 0, 3),
        ({"violated": ["deadlines", "no_deadlock"], "signature_now": "deadlines"}, 0, 3),
        ({"violated": ["stack_runs"], "signature_now": "stack_runs/crash"}, 0, 0),
        ({"fate": "timeout"}, 0, 0),
    ],
)
def test_runs_that_fail_otherwise_do_not_count(campaign, row, failed, runs):
    whole = {"fate": "fixed", "signature_now": "", "violated": [], "jittered": 2, **row}
    counted = bisecting._counted(campaign.records[0], whole)
    assert (counted.failed, counted.runs) == (failed, runs)
