"""Records of trials, made and changed by the names of their parts."""

from __future__ import annotations

import dataclasses
from typing import Any

from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.record import Origin, SearchData, TrialRecord
from mrta_falsify.core.run_result import RunResult

PARTS = {"origin": Origin, "result": RunResult, "search": SearchData}


def trial_record(number: int, u: Any = (), **parts: Any) -> TrialRecord:
    """Make the record of a judged trial.

    Args:
        number: of the trial.
        u: point of the cube.
        parts: as of :func:`changed`.
    """
    record = TrialRecord(candidate=Candidate(number=number, u=u), result=RunResult(status="judged"))
    return changed(record, **parts)


def changed(record: TrialRecord, **parts: Any) -> TrialRecord:
    """Change parts of a record, each by its name in whichever value it belongs to.

    A failure is primary unless ``rank`` says otherwise.

    Args:
        record: of a trial.
        parts: fields of the record, its origin, its result or its search data.
    """
    if "verdicts" in parts:
        fails = any(verdict.violated for verdict in parts["verdicts"])
        parts.setdefault("rank", "primary" if fails else "none")
    for name, kind in PARTS.items():
        own = {field.name for field in dataclasses.fields(kind)} & parts.keys()
        if own:
            before = getattr(record, name) or kind(status="judged")
            changes = {each: parts.pop(each) for each in own}
            parts[name] = dataclasses.replace(before, **changes)
    return dataclasses.replace(record, **parts)
