"""What two runs of one campaign must have in common."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.store import RECORDS, TRIALS

TIMES = frozenset(("wall_s", "scene_s"))  # measured, at any depth of a record


def log_without_times(directory: Path) -> list[Any]:
    """Read the log of a campaign as it lies on disk, in the order of its trials."""
    lines = (directory / RECORDS).read_text().splitlines()
    records = [_without_times(json.loads(line.partition("\t")[2])) for line in lines]
    return sorted(records, key=lambda record: record["candidate"]["number"])


def files_of_trials(directory: Path) -> dict[str, bytes]:
    """Read all files beside the trials of a campaign."""
    paths = [path for path in (directory / TRIALS).rglob("*") if path.is_file()]
    return {str(path.relative_to(directory)): path.read_bytes() for path in paths}


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_times(one) for name, one in value.items() if name not in TIMES}
    return [_without_times(one) for one in value] if isinstance(value, list) else value
