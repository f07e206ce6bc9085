"""The life of findings: what each run of ``ci`` leaves behind for the next.

A finding is a failure mode of one cell, that is of one scenario or corpus on one stack. Its worlds
are run again whenever the cell has changed, also after it was resolved.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from mrta_falsify.core import codec
from mrta_falsify.core.codec import later
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import FormatError

LEDGER_NAME = "last.json"
LEDGER_VERSION = 1
MAX_EXAMPLES = 2  # worlds of a mode that are run again

#: failing: its world fails; flaky: only some runs of it, or few copies; resolved: none any more
Fate: TypeAlias = Literal["failing", "flaky", "resolved"]
#: against the last run
ChangeKind: TypeAlias = Literal["new", "resolved", "ongoing", "flaky"]
_WORST: tuple[Fate, ...] = ("failing", "flaky", "resolved")


@dataclass(frozen=True, slots=True)
class Example:
    """A stored failure: a campaign's directory, relative to the project, and a trial in it."""

    directory: str
    id: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A failure mode of a cell."""

    signature: str  #: in the form of ``rules``
    fate: Fate
    examples: tuple[Example, ...]  #: the best first
    sentence: str  #: what happens in the first of them
    since: int  #: number of the run that saw it first, or saw it come back
    rules: int = later(1)  #: see :mod:`mrta_falsify.campaigns.rules`
    before: tuple[str, ...] = later(())  #: the same in the form of rules 1; several may be one mode
    failure_kind: str = later("")  #: deadlock, stuck or shut; empty: none of them

    def goes_on(self, old: Finding) -> bool:
        """Whether this is the mode ``old`` of an earlier run, in the form that it was stored in."""
        if old.rules == self.rules:
            return old.signature == self.signature
        return old.rules < self.rules and old.signature in self.before


@dataclass(frozen=True, slots=True, kw_only=True)
class CellState:
    """A cell after a run."""

    name: str  #: ``SCENARIO on STACK``
    parts: dict[str, str]  #: digests of all that its result depends on, by what it is
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Ledger:
    """What a finished run leaves behind."""

    version: int = LEDGER_VERSION
    number: int = 0  #: of the run; 0: there was none
    ended: str = ""  #: local date and time
    cells: tuple[CellState, ...] = ()

    def cell(self, name: str) -> CellState | None:
        """Find a cell by name; None if the run had none of that name."""
        return next((cell for cell in self.cells if cell.name == name), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What became of a finding since the last run."""

    kind: ChangeKind
    cell: str
    signature: str
    sentence: str
    since: int  #: number of the run that saw it first
    came_back: bool = False  #: new, but it was resolved once
    example: Example | None = None
    failure_kind: str = later("")  #: deadlock, stuck or shut; empty: none of them


def read_ledger(kept: Path) -> Ledger:
    """Read what the last finished run left behind; an empty one if there was none.

    Raises:
        InputError: the file is damaged, or of another version.
    """
    path = kept / LEDGER_NAME
    if not path.is_file():
        return Ledger()
    data = codec.read_json(path)
    version = data.get("version") if isinstance(data, dict) else None
    if version != LEDGER_VERSION:
        raise FormatError(
            f"{path}: has format version {version}; this reads {LEDGER_VERSION}. Delete it to "
            "begin anew"
        )
    return codec.decode(Ledger, data, where=str(path))


def write_ledger(kept: Path, ledger: Ledger) -> None:
    """Put a finished run in the last one's place, whole or not at all."""
    text = json.dumps(codec.encode(ledger), indent=1) + "\n"
    write_atomically(kept / LEDGER_NAME, text.encode())


def merged(
    before: Iterable[Finding], seen: Iterable[Finding], undecided: Iterable[str], number: int
) -> tuple[Finding, ...]:
    """Merge what a cell had with what a run has seen in it.

    A mode of earlier rules goes on as those that are signed like it in its form.

    Args:
        before: its findings.
        seen: one for each mode and source: rechecked worlds, the search. They may repeat a mode.
        undecided: modes of which a world could not be judged; they keep their fate.
        number: of the run.

    Returns:
        One finding for each mode, by signature.
    """
    known, kept = tuple(before), set(undecided)
    found: dict[tuple[int, str], Finding] = {}
    for one in sorted(seen, key=lambda finding: -finding.rules):
        same = next((other for other in found.values() if other.goes_on(one)), None)
        mode = one if same is None else same
        found[mode.rules, mode.signature] = one if same is None else _worse(same, one)
    now = [_dated(one, known, number) for one in found.values()]
    for old in known:
        if not any(one.goes_on(old) for one in found.values()):
            fate: Fate = old.fate if old.signature in kept else "resolved"
            now.append(dataclasses.replace(old, fate=fate))
    return tuple(sorted(now, key=lambda finding: (finding.signature, finding.rules)))


def _worse(one: Finding, other: Finding) -> Finding:
    """Take the worse of two findings of one mode, signed as ``one``, with the examples of both."""
    first, second = sorted((one, other), key=lambda finding: _WORST.index(finding.fate))
    return dataclasses.replace(
        first,
        signature=one.signature,
        rules=one.rules,
        failure_kind=one.failure_kind or other.failure_kind,
        examples=tuple(dict.fromkeys((*first.examples, *second.examples))),
        sentence=first.sentence or second.sentence,
        before=tuple(dict.fromkeys((*one.before, *other.before))),
    )


def _dated(finding: Finding, known: Sequence[Finding], number: int) -> Finding:
    """Say since which run a mode has been there without a break."""
    began = [old.since for old in known if finding.goes_on(old) and old.fate != "resolved"]
    return dataclasses.replace(finding, since=min(began, default=number))


def changes_of(before: CellState, now: CellState) -> tuple[Change, ...]:
    """Compare a cell with the last run; what was resolved before and still is, is left out."""
    changes = []
    for finding in now.findings:
        old = [one for one in before.findings if finding.goes_on(one)]
        kind = _kind(finding, old)
        if kind is not None:
            changes.append(
                Change(
                    kind=kind,
                    cell=now.name,
                    signature=finding.signature,
                    sentence=finding.sentence,
                    since=finding.since,
                    came_back=kind == "new" and bool(old),
                    example=finding.examples[0] if finding.examples else None,
                    failure_kind=finding.failure_kind,
                )
            )
    return tuple(changes)


def _kind(finding: Finding, old: Sequence[Finding]) -> ChangeKind | None:
    was_open = any(one.fate != "resolved" for one in old)
    if finding.fate == "resolved":
        return "resolved" if was_open else None
    if finding.fate == "flaky":
        return "flaky"
    return "ongoing" if was_open else "new"
