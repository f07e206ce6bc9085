"""The page docs/write-a-scenario.md does what it says, block by block."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main

pytestmark = pytest.mark.filterwarnings("ignore")

PAGE = Path(__file__).parent.parent / "docs" / "write-a-scenario.md"


def blocks() -> Iterator[tuple[str, str]]:
    """Language and text of the page's blocks, in order."""
    yield from re.findall(r"```(\w+)\n(.*?)```", PAGE.read_text(), re.DOTALL)


def commands(text: str) -> Iterator[tuple[list[str], set[int], str]]:
    """Words, allowed exit codes and promised words of each line of a shell block."""
    for line in text.strip().splitlines():
        command, _, promise = line.partition("#")
        codes = re.search(r"exits ([\d or]+)", promise)
        allowed = {int(code) for code in codes[1].split(" or ")} if codes else {0}
        yield shlex.split(command), allowed, promise.partition(": ")[2]


@pytest.mark.slow
def test_the_page_can_be_followed_from_top_to_bottom(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    ran = []
    for language, text in blocks():
        if language == "scenic":
            name = re.match(r"# (\w+\.scenic)\n", text)
            assert name, text
            Path(name[1]).write_text(text)
        elif language == "sh":
            for (program, *words), allowed, promise in commands(text):
                assert program == "mrta-falsify"
                result = CliRunner().invoke(main, words)
                assert result.exit_code in allowed, (words, result.output, result.exception)
                assert promise in result.output + result.stderr, (words, result.output)
                ran.append(words[0])
    assert {"check", "sample", "run", "campaign", "list"} <= set(ran)
    assert (tmp_path / "first" / "report.html").is_file()
    assert (tmp_path / "samples" / "contact_sheet.png").is_file()


def test_every_link_of_the_page_leads_somewhere():
    links = re.findall(r"\]\(([^)#:]+)\)", PAGE.read_text())
    missing = [link for link in links if not (PAGE.parent / link).exists()]
    assert missing == []
