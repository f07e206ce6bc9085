"""A failure family as a Scenic program that samples inside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.findings import Family
from mrta_falsify.core.record import TrialRecord

if TYPE_CHECKING:
    from scenic_worlds.program import Program


def program_text(found: Family, program: Program, record: TrialRecord, campaign: Campaign) -> str:
    """Write the original program, restricted to the family."""
    head = [
        f"Failure family of trial {record.id} of {campaign.directory.name}: {found.signature}",
        "",
        "Runs fail in this way when",
        *(f"  {line}" for line in found.rule),
        "",
    ]
    if found.precision.trials:
        head += [found.sentence, ""]
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
