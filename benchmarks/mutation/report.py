"""The results as a table in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from benchmarks import markdown
from benchmarks.mutation.killing import Hunted
from benchmarks.mutation.mutants import Mutant
from benchmarks.mutation.searching import Searched
from mrta_falsify.campaigns.statistics import failure_probability

BEHAVIOUR = "behaviour"  # kind of a failure that does not name its own line, as a crash does
LONGEST = 110  # characters of a change


def report(
    mutants: Sequence[Mutant], hunted: Mapping[str, Hunted], searched: Iterable[Searched]
) -> str:
    """Write what is known so far.

    Args:
        mutants: all of the benchmark.
        hunted: by mutant, as far as it has been run in the worlds.
        searched: searches that have ended.
    """
    searches: dict[str, list[Searched]] = {}
    for row in searched:
        searches.setdefault(row.sampler, []).append(row)
    parts = [_summary(mutants, hunted), _shares(searches), _killable(mutants, hunted, searches)]
    parts += [_survivors(mutants, hunted), _times(hunted, searches)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _summary(mutants: Sequence[Mutant], hunted: Mapping[str, Hunted]) -> str:
    counts = Counter(row.status for row in hunted.values())
    kinds = Counter(row.kind for row in hunted.values() if row.status == "killable")
    told = ", ".join(f"{number} by {kind}" for kind, number in sorted(kinds.items()))
    rows = [
        f"{len(mutants)} mutants, {len(hunted)} of them run: {counts['killable']} killable",
        f" ({told})" if told else "",
        f", {counts['survived']} survived,\n{counts['unreached']} never reached, ",
        f"{counts['stale']} stale.",
    ]
    return "## Mutants\n\n" + "".join(rows)


def _shares(searches: Mapping[str, Sequence[Searched]]) -> str:
    if not searches:
        return ""
    heads = (
        *("Sampler", "Killed", "by behaviour", "Trials to a kill", "Layer right"),
        *("right by the trace alone", "right of crashes and hangs"),
    )
    rows = [markdown.heads(*heads)]
    for sampler, of in sorted(searches.items()):
        killed = [row for row in of if row.found_at]
        trials = sorted(row.found_at for row in killed)
        median = str(trials[len(trials) // 2]) if trials else "-"
        named = [row for row in killed if row.layer and row.kind == BEHAVIOUR]
        other = [row for row in killed if row.layer and row.kind != BEHAVIOUR]
        cells = [
            f"`{sampler}`",
            _share(len(killed), len(of)),
            str(sum(row.kind == BEHAVIOUR for row in killed)),
            median,
            _share(sum(row.named == row.layer for row in named), len(named)),
            _share(sum(row.guess == row.layer for row in named), len(named)),
            _share(sum(row.named == row.layer for row in other), len(other)),
        ]
        rows.append(markdown.row(*cells))
    return "## Searches for killable mutants\n\n" + "\n".join(rows)


def _share(count: int, total: int) -> str:
    if not total:
        return "0 of 0"
    found = failure_probability(count, total)
    return f"{count} of {total} [{found.low:.0%}, {found.high:.0%}]"


def _killable(
    mutants: Sequence[Mutant],
    hunted: Mapping[str, Hunted],
    searches: Mapping[str, Sequence[Searched]],
) -> str:
    samplers = sorted(searches)
    by = {(row.sampler, row.mutant): row for of in searches.values() for row in of}
    heads = ("Mutant", "Where", "Change", "Layer", "Killed in", "By", "Copies", *samplers)
    rows = [markdown.heads(*heads)]
    for mutant in mutants:
        row = hunted.get(mutant.id)
        if row is None or row.status != "killable":
            continue
        cells = [mutant.id, place_of(mutant), f"`{_short(mutant.what)}`", mutant.layer or "several"]
        cells += [row.case, ", ".join(row.why), row.copies]
        cells += [_found(by.get((sampler, mutant.id))) for sampler in samplers]
        rows.append(markdown.row(*cells))
    return "## Killable\n\n" + "\n".join(rows) if len(rows) > 1 else ""


def _found(row: Searched | None) -> str:
    if row is None:
        return ""
    if not row.found_at:
        return f"no, {row.trials} trials"
    named = row.named or "none"
    right = ", right" if row.named == row.layer else ", wrong"
    return f"{row.found_at}: {', '.join(row.why)}; {named}{right if row.layer else ''}"


def _survivors(mutants: Sequence[Mutant], hunted: Mapping[str, Hunted]) -> str:
    rows = [markdown.heads("Mutant", "Where", "Change", "Why it lives")]
    for mutant in mutants:
        row = hunted.get(mutant.id)
        if row is not None and row.status != "killable":
            cells = (mutant.id, place_of(mutant), f"`{_short(mutant.what)}`", explained(row))
            rows.append(markdown.row(*cells))
    return "## Survivors\n\n" + "\n".join(rows) if len(rows) > 1 else ""


def explained(row: Hunted) -> str:
    """Say in a line why a mutant is alive."""
    if row.status == "stale":
        return row.error
    if row.status == "unreached":
        return "its lines run in none of the worlds"
    if not row.differing:
        return f"reached in {row.reached} worlds, and all {row.worlds} traces are the sound ones"
    edges = len(row.knife_edges)
    near = f"; fails in {edges}, but not by the copies' rule" if edges else ""
    return f"{row.differing} of {row.worlds} traces differ, and nothing is violated{near}"


def _times(hunted: Mapping[str, Hunted], searches: Mapping[str, Sequence[Searched]]) -> str:
    heads = ("Part", "Mutants", "Minutes of workers", "CPU of mutants", "CPU compiling")
    rows = [markdown.heads(*heads)]
    parts: dict[str, Sequence[Hunted | Searched]] = {"killable": list(hunted.values())}
    parts |= {f"`{sampler}`": of for sampler, of in sorted(searches.items())}
    for name, of in parts.items():
        minutes = [
            f"{sum(seconds) / 60.0:.1f}"
            for seconds in (
                [row.wall_s for row in of],
                [row.cpu_s for row in of],
                [row.compile_s for row in of],
            )
        ]
        rows.append(markdown.row(name, len(of), *minutes))
    return "## Times [min]\n\n" + "\n".join(rows)


def place_of(mutant: Mutant) -> str:
    """Name the file and line of a mutant's first change."""
    first = mutant.edits[0]
    return f"{first.path.removeprefix('mrta_falsify/')}:{first.line}"


def _short(text: str) -> str:
    text = text.replace("|", "\\|").replace("`", "'")
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
