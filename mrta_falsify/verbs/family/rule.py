"""What a failure family says: its conditions, in words and as a Scenic program."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from mrta_falsify.campaigns.statistics import Probability
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.record import TrialRecord

if TYPE_CHECKING:
    from scenic_worlds.program import Program

Fate = Literal["interval", "held", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """What the rule says about one dimension."""

    dimension: str
    fate: Fate  #: unknown: held too, because the runs did not suffice to try it
    low: float  #: shares of the dimension's range
    high: float
    text: str  #: in the program's units


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """A failure's family."""

    signature: str
    engine: str  #: of all runs
    conditions: tuple[Condition, ...]
    free: tuple[str, ...]  #: dimensions that do not matter
    noise_seed: int | None  #: fixed because other noise cures the failure
    precision: Probability  #: on fresh samples of the written program
    elsewhere: tuple[int, int]  #: trials of the campaign with the signature, of how many judged
    learning_runs: int
    no_scene: int  #: fresh samples for which no valid scene was found
    passing: tuple[str, ...] = ()  #: the nearest neighbours that pass, in words
    program: str = ""  #: path of the Scenic program


def summary(found: Family) -> dict[str, Any]:
    """The family as JSON-shaped data."""
    return {
        **dataclasses.asdict(found),
        "conditions": [dataclasses.asdict(condition) for condition in found.conditions],
        "free": list(found.free),
        "passing": list(found.passing),
        "elsewhere": list(found.elsewhere),
        "rule": rule_lines(found),
        "sentence": sentence(found),
    }


def rule_lines(found: Family) -> list[str]:
    """The rule, a line for each condition."""
    lines = [
        c.text + (" (not tried: out of runs)" if c.fate == "unknown" else "")
        for c in found.conditions
    ]
    if found.noise_seed is not None:
        lines.append(f"the noise of seed {found.noise_seed}")
    return lines or ["anything the program gives"]


def sentence(found: Family) -> str:
    """How good the rule is."""
    measured = found.precision
    here, judged = found.elsewhere
    if not measured.trials:
        return "No fresh sample of the family had a valid scene."
    return (
        f"{measured.failures} of {measured.trials} fresh samples of the family fail with this "
        f"signature on the {found.engine} engine ({measured.level:.0%} interval "
        f"{measured.low:.2f} to {measured.high:.2f}); in the campaign it was {here} of {judged} "
        f"trials. {len(found.free)} dimensions do not matter, {len(found.conditions)} do."
    )


def program_text(found: Family, program: Program, record: TrialRecord, campaign: Campaign) -> str:
    """The original program, restricted to the family."""
    head = [
        f"Failure family of trial {record.id} of {campaign.directory.name}: {found.signature}",
        "",
        "Runs fail in this way when",
        *(f"  {line}" for line in rule_lines(found)),
        "",
    ]
    if found.precision.trials:
        head += [sentence(found), ""]
    if program.params:
        given = " ".join(f"-p {name}={value}" for name, value in sorted(program.params.items()))
        head += [f"Give the same parameters as the campaign: {given}", ""]
    head.append(f"{program.path.name} follows; its last lines restrict it to the family.")
    comments = "\n".join(f"# {line}".rstrip() for line in head)
    pairs = "".join(
        f"    {c.dimension!r}: ({c.low!r}, {c.high!r}),  # {c.text}\n" for c in found.conditions
    )
    body = program.path.read_text(encoding="utf-8").rstrip("\n")
    seed = "" if found.noise_seed is None else f"param noise_seed = {found.noise_seed}\n"
    restrict = "param restrict = {  # share of each dimension's range\n" + pairs + "}\n"
    return f"{comments}\n\n{body}\n\n{restrict}{seed}"
