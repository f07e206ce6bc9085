"""Draw a stored failure as the gallery does: as found, at its smallest, and who waits for whom.

    python -m tools.draw_failure DIR ID FILE.png

The trial must have been minimised (`mrta-falsify minimize DIR ID`). Nothing is simulated.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Minimisation
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import read_world
from mrta_falsify.specs.causes import leading
from tools.gallery_pictures import Seen, write_picture


def seen_in(folder: Path, found: Sequence[Verdict], smallest: Sequence[Verdict]) -> list[Seen]:
    """Read a failing run and its smallest one from a trial's folder.

    Args:
        folder: of the trial.
        found: verdicts of the run as it was found.
        smallest: verdicts of the run in the smallest world.

    Raises:
        InputError: one of them violates nothing.
    """
    return [
        Seen(
            world=read_world(folder / world),
            trace=read_trace(folder / trace),
            verdict=_leading(verdicts),
        )
        for world, trace, verdicts in (
            ("world.json", "trace.zip", found),
            ("world.min.json", "trace.min.zip", smallest),
        )
    ]


def _leading(verdicts: Sequence[Verdict]) -> Verdict:
    verdict = leading(verdicts)
    if verdict is None:
        raise InputError("the trial violates nothing; choose another one")
    return verdict


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path, help="its directory")
    parser.add_argument("trial", help="its id")
    parser.add_argument("picture", type=Path, help="the PNG")
    arguments = parser.parse_args()
    campaign = open_campaign(arguments.campaign)
    record = campaign.record(arguments.trial)
    folder = campaign.folder(record)
    small = read_finding(folder, Minimisation)
    if small is None:
        parser.error(f"trial {record.id} is not minimised: mrta-falsify minimize DIR {record.id}")
    original, smallest = seen_in(folder, record.verdicts, small.verdicts)
    write_picture(original, smallest, arguments.picture)


if __name__ == "__main__":
    main()
