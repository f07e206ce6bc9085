"""The tutorials of docs/ do what they say, block by block.

``scenic`` blocks are files, and so are ``yaml`` blocks that begin with a name; a line of an ``sh``
block is a command. Its comment may promise exit codes and words that are printed: ``# exits 0 or
1``, ``# exits 2: unknown room``, ``# says: ok``.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main

pytestmark = pytest.mark.filterwarnings("ignore")

DOCS = Path(__file__).parent.parent / "docs"
#: pages that are followed one after the other in one folder, and what is there in the end
COURSES = {
    ("write-a-scenario",): ("first/report.html", "samples/contact_sheet.png"),
    ("first-campaign", "in-ci"): (
        "runs/first/report.html", "samples/contact_sheet.png", "ticket.md", "night.xml",
        ".mrta-falsify/report.html",
    ),
    ("own-stack",): ("own/my_stack.py", "runs/own/campaign.json"),
}  # fmt: skip


def blocks(page: str) -> Iterator[tuple[str, str]]:
    """Language and text of a page's blocks, in order."""
    yield from re.findall(r"```(\w+)\n(.*?)```", (DOCS / f"{page}.md").read_text(), re.DOTALL)


def commands(text: str) -> Iterator[tuple[list[str], set[int], str]]:
    """Words, allowed exit codes and promised words of each line of a shell block."""
    for line in text.strip().replace("\\\n", " ").splitlines():
        command, _, promise = line.partition(" # ")
        codes = re.search(r"exits ([\d or]+)", promise)
        allowed = {int(code) for code in codes[1].split(" or ")} if codes else {0}
        yield shlex.split(command), allowed, promise.partition(": ")[2]


def follow(page: str) -> None:
    """Do what a page says, in the current folder."""
    for language, text in blocks(page):
        if language == "scenic":
            name = re.match(r"# (\w+\.scenic)\n", text)
            assert name, text
            Path(name[1]).write_text(text)
        elif language == "yaml" and (name := re.match(r"# (\S+\.yaml)\n", text)):
            Path(name[1]).write_text(text)
        elif language == "sh":
            for (program, *words), allowed, promise in commands(text):
                assert program == "mrta-falsify"
                result = CliRunner().invoke(main, words)
                assert result.exit_code in allowed, (words, result.output, result.exception)
                assert promise in result.output, (words, result.output)


@pytest.mark.long
@pytest.mark.timeout(1800)  # one explains and minimises a failure
@pytest.mark.parametrize("pages", COURSES, ids="+".join)
def test_the_pages_can_be_followed_from_top_to_bottom(pages, tmp_path, monkeypatch):
    if "own-stack" in pages and sys.platform != "linux":
        pytest.skip("processes are kept on Linux")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:/usr/bin:/bin")  # `python3` is ours
    for page in pages:
        follow(page)
    missing = [name for name in COURSES[pages] if not (tmp_path / name).is_file()]
    assert missing == []


@pytest.mark.parametrize("page", [page for pages in COURSES for page in pages])
def test_a_page_has_commands_to_follow(page):
    lines = [line for language, text in blocks(page) if language == "sh" for line in commands(text)]
    assert len(lines) >= 3
