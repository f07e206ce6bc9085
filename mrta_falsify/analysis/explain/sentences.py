"""What re-runs say of a failure, in sentences: what it needs, and when it was decided."""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.core.findings import ChangedRun, Explanation, Fate
from mrta_falsify.core.inevitability import (
    ChanceCurve,
    Inevitability,
    decisive,
    moves_the_turn,
)
from mrta_falsify.core.probability import interval_text
from mrta_falsify.core.words import listed


def needs_sentences(found: Explanation) -> tuple[str, ...]:
    """Say without what a failure is gone, and whether it depends on the schedule."""
    sentences = [*_absence_sentences(found.absences), *_schedule_sentences(found.schedules)]
    is_gone = any(run.fate == "gone" for run in (*found.absences, *found.schedules))
    if is_gone and found.jittered.most_pass:
        sentences.append(
            "Most perturbed runs pass, so any change may remove the failure: these sentences say "
            "little."
        )
    return tuple(sentences)


def _absence_sentences(runs: Sequence[ChangedRun]) -> list[str]:
    sentences = []
    gone = [run for run in runs if run.fate == "gone" and not _has_cure_within(run, runs)]
    if gone:
        sentences.append(f"The failure is gone {_without(gone)}.")
    stays = _of(runs, "stays")
    if stays:
        sentences.append(f"The failure stays {_without(stays)}.")
    sentences += [
        f"Without {run.change} the specification is {run.detail}." for run in _of(runs, "otherwise")
    ]
    sentences += [f"No answer without {run.change}: {run.detail}." for run in _of(runs, "unknown")]
    untried = _of(runs, "untried")
    if untried:
        sentences.append(f"Not tried {_without(untried)}: the runs were used up (--max-runs).")
    return sentences


def _schedule_sentences(runs: Sequence[ChangedRun]) -> list[str]:
    stays, gone = _of(runs, "stays"), [r for r in runs if r.fate in ("gone", "otherwise")]
    sentences = []
    if gone:
        other = [
            f"{run.change} ({run.detail})" if run.fate == "otherwise" else run.change
            for run in gone
        ]
        kept = f"; it stays with {_list(stays)}" if stays else ""
        sentences.append(
            f"The failure depends on the schedule: it is not there with {listed(other)}{kept}."
        )
    elif stays:
        sentences.append(
            f"The failure does not depend on the schedule: it stays with {_list(stays)}."
        )
    sentences += [f"No answer with {run.change}: {run.detail}." for run in _of(runs, "unknown")]
    return sentences


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
    counts = (f" ({run.detail})" if run.vote is not None else "" for run in runs)
    return listed([f"without {run.change}{n}" for run, n in zip(runs, counts, strict=True)])


def _list(runs: Sequence[ChangedRun]) -> str:
    return listed([run.change for run in runs])


# --- when it was decided -----------------------------------------------------------------


def decided_sentences(found: Inevitability | None, layer: str) -> tuple[str, ...]:
    """Say when a failure was decided, by which layer, and what else would have averted it.

    Args:
        found: by rewinding the run; None: it was not rewound.
        layer: that the rows name. No other is told to have decided it: rewinding asks few layers,
            and not whether any other removes the failure as well.
    """
    if found is None:
        return ()
    sentences = []
    if found.decided_at is not None:
        stack, *others = found.curves
        first = decisive(found.curves)
        sentences = [
            _decided(found, layer),
            _turn_sentence(stack, stack.change[0].upper() + stack.change[1:]),
        ]
        sentences += [_turn_sentence(first, f"With {first.change}")] if first else []
        sentences += [
            f"Until {curve.open_until:.1f} s it would have been averted, too: {curve.change}."
            for curve in others
            if curve is not first and moves_the_turn(curve, stack)
        ]
    if found.left_out:
        sentences.append(f"Not rewound: {found.left_out}.")
    return tuple(sentences)


def _decided(found: Inevitability, layer: str) -> str:
    by = f", by the {found.by.replace('_', ' ')}" if found.by and found.by == layer else ""
    exchanged = sum(curve.replaced == "layer" for curve in found.curves)
    if exchanged and not found.by:
        none = "the one exchange tried would not" if exchanged == 1 else "no exchange tried would"
        by = f", and {none} have averted it from then on"
    if found.decided_at == 0.0:
        return f"It was decided from the start{by}."
    return f"It was decided at {found.decided_at:.1f} s{by}."


def _turn_sentence(curve: ChanceCurve, what: str) -> str:
    """Say how often the run fails when it is repeated from either side of the turn."""
    before = curve.at(curve.open_until) if curve.open_until is not None else None
    after = curve.at(curve.lost_from)
    parts = [
        f"{point.chance.failures} of {point.chance.trials} runs fail when the run is repeated "
        f"from {point.time:.1f} s "
        f"({interval_text(point.chance.low, point.chance.high, point.chance.level)})"
        for point in (before, after)
        if point is not None
    ]
    if after is None:
        parts.append(
            f"no time from there to the violation at {curve.lost_from:.1f} s was looked at"
        )
    return f"{what}: {', '.join(parts)}."
