"""Commands that a report gives for a failure: what each does, and what to type."""

from __future__ import annotations

import shlex
from pathlib import Path

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.core.record import TrialRecord

Commands = tuple[tuple[str, str], ...]


def commands_of(campaign: Campaign, record: TrialRecord) -> Commands:
    """List the commands that run, check and explain a failure."""
    where = [str(campaign.directory), record.id]
    world = campaign.folder(record) / "world.json"
    theirs = _command("Run the other stack in its world again", "replay", *where, "--against")
    return (
        _command("Run the trial again and compare digests", "replay", *where, "--verify", "3"),
        *((theirs,) if record.other is not None else ()),
        _command("Ask which layer is to blame", "explain", *where),
        _command("Find the smallest world that fails in the same way", "minimize", *where),
        _command(
            "Run its world on its own, with your stack",
            *("run", str(world), "--stack", "my_stack.yaml"),
        ),
    )


def minimised_commands(folder: Path) -> Commands:
    """List the commands that run a minimised world on the stack that it fails on, and the other.

    Args:
        folder: of the trial.
    """
    runs = [
        ("Run it", "world.min.json", "stack.yaml"),
        ("Run it from its Scenic program", "world.min.scenic", "stack.yaml"),
    ]
    if (folder / "stack.other.yaml").is_file():
        runs.append(("Run it on the other stack", "world.min.json", "stack.other.yaml"))
    return tuple(
        _command(
            what,
            *("run", str(folder / world)),
            *(("--stack", str(folder / stack)) if (folder / stack).is_file() else ()),
        )
        for what, world, stack in runs
        if (folder / world).is_file()
    )


def _command(what: str, *words: str) -> tuple[str, str]:
    return what, shlex.join(["mrta-falsify", *words])
