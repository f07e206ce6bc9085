"""Someone who never saw the project and has only the text of a report.

Knows English and how a report is laid out, nothing of the campaign, the stack or our code.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from html.parser import HTMLParser


@dataclass(frozen=True)
class Answers:
    """To the five questions, as far as the text gives them."""

    deadlocked: tuple[str, ...]  #: what deadlocked?
    found: float | None  #: when was it found [s]?
    since: float | None  #: and since when do they stand [s]?
    waits: tuple[tuple[str, str, str], ...]  #: who waits for whom (or what), and why
    layer: str  #: which layer is suspected?
    evidence: str  #: on what evidence?
    again: str  #: how do I run it again?


class _Text(HTMLParser):
    """Text as a person sees it: no scripts, no styles, a line per block."""

    BLOCKS = frozenset(
        ("p", "li", "h1", "h2", "h3", "h4", "dt", "dd", "td", "th", "pre", "summary")
    )
    UNSEEN = frozenset(("script", "style", "svg", "title"))

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = [""]
        self._unseen = 0

    def handle_starttag(self, tag, attrs):
        self._unseen += tag in self.UNSEEN
        if tag in self.BLOCKS:
            self.lines.append("")

    def handle_endtag(self, tag):
        self._unseen -= tag in self.UNSEEN
        if tag in self.BLOCKS:
            self.lines.append("")

    def handle_data(self, data):
        if not self._unseen:
            self.lines[-1] += data


def lines_of(html: str) -> list[str]:
    """The text of a page, a line per paragraph, list item or cell."""
    reader = _Text()
    reader.feed(html)
    lines = (" ".join(line.split()) for line in reader.lines)
    return [line for line in lines if line]


#: how a sentence says who is waited for, and the reason it gives
WAITS = (
    (
        r"^(\S+) waits for (\S+), and no robot keeps it out",
        lambda m: (m[1], m[2], "kept out by no robot"),
    ),
    (r"^(\S+) waits for (\S+): (\S+) holds it", lambda m: (m[1], m[3], f"holds {m[2]}")),
    (r"^(\S+) cannot drive on because (\S+) stands in", lambda m: (m[1], m[2], "on its path")),
    (r"^(\S+) has a free path but waits for (\S+),", lambda m: (m[1], m[2], "in turn")),
    (r"^(\S+) stands still because (\S+), a person", lambda m: (m[1], m[2], "person in the way")),
    (r"^(\S+) is held back by a solid: (\S+)\.", lambda m: (m[1], m[2], "solid in the way")),
)


def read(html: str) -> Answers:
    """Look for the answers in the text of a report with one case."""
    lines = lines_of(html)
    text = "\n".join(lines)
    stuck = "is stuck|are stuck|wait for each other|hold each other up"
    what = re.search(rf"^(.+?) (?:{stuck})\b(.*found at.*)$", text, re.MULTILINE)
    names = re.findall(r"[\w-]+", what[1].replace(" and ", ", ")) if what else []
    found = re.search(r"\(found at ([\d.]+) s\)", what[2]) if what else None
    since = re.search(r"no progress since ([\d.]+) s", what[2]) if what else None
    waits = [
        told(match)
        for line in lines
        for pattern, told in WAITS
        if (match := re.search(pattern, line)) is not None
    ]
    layer = re.search(r"^Suspected layer: (\w+)\. (.+)$", text, re.MULTILINE)
    again = re.search(r"^Run it again: (.+)$", text, re.MULTILINE)
    return Answers(
        deadlocked=tuple(names),
        found=float(found[1]) if found else None,
        since=float(since[1]) if since else None,
        waits=tuple(dict.fromkeys(waits)),
        layer=layer[1] if layer else "",
        evidence=layer[2] if layer else "",
        again=again[1] if again else "",
    )
