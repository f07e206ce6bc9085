"""What changed runs of the whole world say of a failure, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.core.findings import ChangedRun, Explanation, Fate
from reports.sentences import listed


def needs_sentences(found: Explanation) -> tuple[str, ...]:
    """Say without what a failure is gone, and whether it depends on the schedule."""
    told = [*_absence_sentences(found.absences), *_schedule_sentences(found.schedules)]
    is_gone = any(run.fate == "gone" for run in (*found.absences, *found.schedules))
    if is_gone and found.jittered.is_knife_edge:
        told.append(
            "Most copies with small differences pass, so any change may remove the failure: these "
            "say little."
        )
    return tuple(told)


def _absence_sentences(runs: Sequence[ChangedRun]) -> list[str]:
    told = []
    gone = [run for run in runs if run.fate == "gone" and not _has_cure_within(run, runs)]
    if gone:
        told.append(f"The failure is gone {_without(gone)}.")
    stays = _of(runs, "stays")
    if stays:
        told.append(f"The failure stays {_without(stays)}.")
    told += [
        f"Without {run.change} the specification is {run.detail}." for run in _of(runs, "otherwise")
    ]
    told += [f"No answer without {run.change}: {run.detail}." for run in _of(runs, "unknown")]
    untried = _of(runs, "untried")
    if untried:
        told.append(f"Not tried {_without(untried)}: the runs were used up (--max-runs).")
    return told


def _schedule_sentences(runs: Sequence[ChangedRun]) -> list[str]:
    stays, gone = _of(runs, "stays"), [r for r in runs if r.fate in ("gone", "otherwise")]
    told = []
    if gone:
        other = [
            f"{run.change} ({run.detail})" if run.fate == "otherwise" else run.change
            for run in gone
        ]
        kept = f"; it stays with {_list(stays)}" if stays else ""
        told.append(
            f"The failure depends on the schedule: it is not there with {listed(other)}{kept}."
        )
    elif stays:
        told.append(f"The failure does not depend on the schedule: it stays with {_list(stays)}.")
    told += [f"No answer with {run.change}: {run.detail}." for run in _of(runs, "unknown")]
    return told


def _of(runs: Sequence[ChangedRun], fate: Fate) -> list[ChangedRun]:
    return [run for run in runs if run.fate == fate]


def _has_cure_within(run: ChangedRun, runs: Sequence[ChangedRun]) -> bool:
    """Whether the failure is gone without a part of what a run leaves out, too."""
    things = set(run.things)
    return any(
        other.fate == "gone" and other.group == run.group and things > set(other.things)
        for other in runs
    )


def _without(runs: Sequence[ChangedRun]) -> str:
    return listed([f"without {run.change}" for run in runs])


def _list(runs: Sequence[ChangedRun]) -> str:
    return listed([run.change for run in runs])
