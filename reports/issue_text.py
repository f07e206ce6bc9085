"""A stored failure as the text of an issue, in Markdown."""

from __future__ import annotations

from dataclasses import dataclass

from reports.markdown import code, plain

MAX_LINES = 60  # of the world inside the text


@dataclass(frozen=True, slots=True, kw_only=True)
class IssueContents:
    """What the text of an issue says."""

    signature: str
    happened: tuple[str, ...]  #: sentences, what came first before who waits for whom
    #: of the world as a Scenic program; empty: it cannot be written as one
    program: str
    about_world: str  #: how small it is, in a sentence
    commands: tuple[tuple[str, str], ...]  #: what each does, and what to type
    versions: tuple[tuple[str, str], ...]
    pictures: tuple[tuple[str, str], ...]  #: what each shows, and its file beside the text
    formats: tuple[tuple[str, str], ...]  #: for whom, and the file or folder beside the text
    missing: tuple[str, ...] = ()  #: what could not be written, and why
    facts: tuple[tuple[str, str], ...] = ()  #: digests, how often it fails


def render_issue(issue: IssueContents) -> str:
    """Render the text of an issue as Markdown.

    What looks like Markdown or HTML in names stays as it is. The world is inside if it has at most
    :data:`MAX_LINES` lines.
    """
    first, *others = issue.happened
    lines = [f"# {plain(first)}", "", *(plain(text) for text in others[:1]), ""]
    for what, file in issue.pictures:
        lines += [f"![{plain(what)}]({file})", ""]
    lines += ["## World", "", plain(issue.about_world), "", *_program(issue.program)]
    lines += ["## How to run it", ""]
    for what, command in issue.commands:
        lines += [f"{plain(what)}:", "", *_block("", command)]
    lines += ["## The scene for other systems", ""]
    lines += [f"- {plain(what)}: {code(file)}" for what, file in issue.formats]
    lines += [f"- {plain(text)}" for text in issue.missing]
    lines += ["", "## Facts", "", f"- failure mode: {code(issue.signature)}"]
    lines += [f"- {plain(label)}: {plain(text)}" for label, text in issue.facts]
    versions = ", ".join(f"{name} {number}" for name, number in issue.versions)
    lines += [f"- versions: {plain(versions)}"]
    return "\n".join(lines).rstrip() + "\n"


def _program(text: str) -> list[str]:
    count = len(text.splitlines())
    if not text:
        return []
    if count > MAX_LINES:
        return [f"It has {count} lines as a Scenic program, too many for here.", ""]
    return _block("scenic", text)


def _block(language: str, text: str) -> list[str]:
    """Fence a text by more backticks than begin any of its lines."""
    fence = "```"
    while any(line.lstrip().startswith(fence) for line in text.splitlines()):
        fence += "`"
    return [f"{fence}{language}", text.rstrip("\n"), fence, ""]
