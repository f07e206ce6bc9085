"""From somebody else's floor to a campaign: what do the floors in a folder give?

    git clone https://github.com/open-rmf/rmf_demos && git clone https://github.com/boschresearch/remroc
    python -m experiments.floors rmf_demos remroc/remroc/worlds/maps [FILE ...] -o OUT [--trials 10]
    python -m experiments.floors -o OUT --table

Every Open-RMF building (each level), Nav2 map and SDF world named, or found in a folder that is
named, is imported and gets a campaign of ``--trials`` random days with the scenario and the stack
that ``import`` writes. The floors themselves are not part of this repository. A map without a file
of rooms beside it gets ``PLACES`` places, spread over the floor that a robot reaches. A row per
floor is kept in OUT/floors.jsonl; a second call goes on. ``--table`` writes them as Markdown.

Which failures are the import's and not the floor's is for a person to say, from the pages and the
pictures under OUT. The column *doors* counts rooms with a door found, of all rooms.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy import ndimage

from experiments.markdown import heads
from experiments.markdown import row as line
from experiments.reports.stored_failures import cpu_seconds
from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.core.errors import FormatError
from mrta_falsify.commands.stored_trials import open_campaign
from simulator_interface.formats.nav2 import read_nav2_map

PLACES = 6  # on a map without rooms
CLEARANCE = 0.6  # m of free floor about such a place
KINDS = ("*.building.yaml", "*.yaml", "*.sdf", "*.world")


def main() -> None:
    """Import what is asked for, and run campaigns on it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("places", type=Path, nargs="*")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--table", action="store_true")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    rows = options.output / "floors.jsonl"
    done = {row["floor"] for row in read_rows(rows)}
    for path, level in floors_of(options.places):
        name = path.name.partition(".")[0] + (f"_{level}" if level else "")
        if name not in done:
            row = tried(name, path, level, options.output / name, options.trials)
            append_row(rows, row)
            print(json.dumps(row), flush=True)
    if options.table:
        head, cells = as_table(read_rows(rows))
        print(heads(*head), *(line(*each) for each in cells), sep="\n")


def floors_of(places: Sequence[Path]) -> Iterator[tuple[Path, str]]:
    """List floors: files, and levels of buildings (empty: the file has no levels)."""
    for place in places:
        found = [place] if place.is_file() else sorted({f for k in KINDS for f in place.rglob(k)})
        for path in found:
            if path.name.endswith(".building.yaml"):
                levels = yaml.safe_load(path.read_text(encoding="utf-8"))["levels"]
                several = len(levels) > 1
                yield from ((path, str(level) if several else "") for level in levels)
            elif path.suffix != ".yaml" or is_map(path):
                yield path, ""


def is_map(path: Path) -> bool:
    """Whether a YAML file is a Nav2 map."""
    try:
        read_nav2_map(path)
    except FormatError:
        return False
    return True


def tried(name: str, path: Path, level: str, folder: Path, trials: int) -> dict[str, Any]:
    """Import a floor and run a campaign on it; return its row."""
    rooms = list(path.parent.glob(f"{path.stem}.rooms.yaml"))
    named = path.name.endswith(".building.yaml") or bool(rooms)
    row: dict[str, Any] = {"floor": name, "named": named, "trials": 0}
    more = ["--level", level] if level else []
    if not named and path.suffix == ".yaml":
        spread = folder / "spread.rooms.yaml"
        folder.mkdir(parents=True, exist_ok=True)
        spread.write_text(yaml.safe_dump({"rooms": spread_places(path)}), encoding="utf-8")
        more += ["--rooms", str(spread)]
    began = cpu_seconds()
    done = said("import", path, "-o", folder, "--format", "json", *more)
    row["import_s"] = round(cpu_seconds() - began, 1)
    if done.returncode:
        return {**row, "error": done.stderr.strip().splitlines()[-1]}
    told = json.loads(done.stdout)
    row |= {
        "rooms": len(told["rooms"]),
        "doors": sum(room["door"] is not None for room in told["rooms"]),
        "parking": told["parking"],
        "size": [round(side) for side in told["size"]],
        "warnings": told["warnings"],
    }
    runs = folder / "runs"
    shutil.rmtree(runs, ignore_errors=True)
    done = said("campaign", told["scenario"], "-o", runs, "--sampler", "random",
                "--budget", trials)  # fmt: skip
    if done.returncode not in (0, 1):
        return {**row, "error": done.stderr.strip().splitlines()[-1]}
    records = open_campaign(runs).records
    failures = Counter(record.signature for record in records if record.failed)
    return {**row, "trials": len(records), "failures": dict(failures)}


def spread_places(path: Path) -> list[dict[str, Any]]:
    """Choose places of a map: each as far from the others as can be, where a robot gets to."""
    grid = read_nav2_map(path)
    room = ndimage.distance_transform_edt(grid.data == 0) * grid.resolution
    parts, _ = ndimage.label(room > CLEARANCE)
    largest = np.argmax(np.bincount(parts.ravel())[1:]) + 1
    cells = np.argwhere(parts == largest)
    chosen = [cells[0]]
    gaps = np.full(len(cells), np.inf)
    for _ in range(PLACES - 1):
        gaps = np.minimum(gaps, np.hypot(*(cells - chosen[-1]).T))
        chosen.append(cells[int(np.argmax(gaps))])
    points = [(cell[::-1] + 0.5) * grid.resolution + grid.origin for cell in chosen]
    return [
        {"name": f"place_{i}", "point": [round(float(x), 2), round(float(y), 2)]}
        for i, (x, y) in enumerate(points)
    ]


def said(*words: object) -> subprocess.CompletedProcess[str]:
    """Run a command of the toolkit."""
    command = [sys.executable, "-m", "mrta_falsify", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def as_table(rows: Sequence[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Write rows as head and cells."""
    head = ["Floor", "m", "Import, s of CPU", "Rooms", "Doors", "Parking", "Trials",
            "Failures by kind"]  # fmt: skip
    cells = []
    for row in rows:
        if "error" in row:
            cells.append([row["floor"], "", f"{row['import_s']:.0f}", *[""] * 4, row["error"]])
            continue
        kinds = [f"{kind or 'other'}: {n}" for kind, n in sorted(row["failures"].items())]
        cells.append([
            row["floor"],
            " x ".join(map(str, row["size"])),
            f"{row['import_s']:.0f}",
            str(row["rooms"]) if row["named"] else f"{row['rooms']} (spread)",
            str(row["doors"]),
            str(row["parking"]),
            str(row["trials"]),
            ", ".join(kinds) or "none",
        ])  # fmt: skip
    return head, cells


if __name__ == "__main__":
    main()
