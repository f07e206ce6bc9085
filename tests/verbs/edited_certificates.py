"""How many confirmed deadlocks have a certificate, and are edited ones refused?

    python -m tests.verbs.edited_certificates [--kinds KIND ...] [--rounds N] [--edits N] -o FOLDER

Runs cases of the oracle's benchmark until the oracle claims a deadlock, and looks for a certificate
of it. Then it edits certificates at random: a robot left out or put in, an edge turned round, a
pose or goal moved by 0.3 m, a resource renamed, times shifted, a trace or world changed. All
digests are computed anew, and the checker must refuse each. Cases that are there are not run again.
"""

from __future__ import annotations

import argparse
import collections
import io
import json
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from experiments.oracle.worlds import KINDS, case_named, cases
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.core import codec
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import write_world
from mrta_falsify.specs.deadlock.oracle import NoDeadlock
from mrta_falsify.verbs.certify import checker
from mrta_falsify.verbs.certify.certifying import REFUSALS, certify
from simulator_interface.simulate import simulate

SHIFT = 0.3  # m or s
SETTLE = 20.0  # s that a run goes on after the claim
LOOK = 5  # ticks
COLUMNS = ("time", "pose", "goal", "tasks_left")  # of a trace, that a certificate rests on

Data = dict[str, Any]
Edit = Callable[[Data, np.random.Generator], bool]


# --- certificates ----------------------------------------------------------------------------


def case_row(name: str, root: Path) -> Data | None:
    """Run a case; None if the oracle claims no deadlock in it."""
    case = case_named(name)
    oracle = NoDeadlock(NoDeadlock.Options())

    def stop(frame: Frame) -> str:
        """End a while after the claim, so that robots have come to rest."""
        at = oracle.verdict().violated_at if frame.sensed.tick % LOOK == 0 else None
        return "decided" if at is not None and frame.sensed.time >= at + SETTLE else ""

    outcome = simulate(case.world, case.config, specifications=(oracle,), stop=stop)
    found = [verdict for verdict in outcome.verdicts if verdict.violated]
    if not found:
        return None
    folder = root / name.replace("/", "_")
    folder.mkdir(parents=True, exist_ok=True)
    write_world(case.world, folder / "world.json")
    write_trace(outcome.trace, folder / "trace.zip")
    sought = certify(folder, found[0].who)
    row: Data = {"case": name, "kind": case.kind, "certified": False, "why": sought.missing}
    if sought.certificate is not None:
        write_finding(folder, sought.certificate)
        accepted_again(folder)
        members = sought.certificate.members
        row |= {"certified": True, "members": len(members), "claimed": len(found[0].who)}
        row |= {"kind_of_reasons": sorted({"area" if one.area else "path" for one in members})}
    return row


def accepted_again(folder: Path) -> None:
    """Check a certificate as it is on disk.

    Raises:
        ValueError: it is refused.
    """
    checker.accept(folder, json.loads((folder / "certificate.json").read_text()))


# --- edits -----------------------------------------------------------------------------------


def any_of(rows: list[Any], random: np.random.Generator) -> Any:
    return rows[int(random.integers(len(rows)))]


def drop_member(data: Data, random: np.random.Generator) -> bool:
    data["members"].remove(any_of(data["members"], random))
    return True


def drop_edge(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    if not row["robots"]:
        return False
    row["robots"].remove(any_of(row["robots"], random))
    return True


def turn_edge(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    others = {one["name"]: one for one in data["members"]}
    ends = [name for name in row["robots"] if name in others]
    if not ends:
        return False
    end = any_of(ends, random)
    row["robots"].remove(end)
    if row["name"] not in others[end]["robots"]:
        others[end]["robots"].append(row["name"])
    return True


def add_edge(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    new = [one["name"] for one in (*data["members"], *data["resting"])]
    new = [name for name in new if name not in (*row["robots"], row["name"])]
    if not new:
        return False
    row["robots"].append(any_of(new, random))
    return True


def move_pose(data: Data, random: np.random.Generator) -> bool:
    row = any_of([*data["members"], *data["resting"]], random)
    angle = random.uniform(0.0, 2.0 * np.pi)
    x, y = row["pose"]
    row["pose"] = [x + SHIFT * np.cos(angle), y + SHIFT * np.sin(angle)]
    return True


def move_goal(data: Data, random: np.random.Generator) -> bool:
    row = any_of(data["members"], random)
    row["goal"][int(random.integers(2))] += SHIFT * random.choice([-1.0, 1.0])
    return True


def rename_area(data: Data, random: np.random.Generator) -> bool:
    rows = [row for row in data["members"] if row["area"]]
    if not rows:
        return False
    any_of(rows, random)["area"] += "_2"
    return True


def rename_robot(data: Data, random: np.random.Generator) -> bool:
    any_of(data["members"], random)["name"] += "_2"
    return True


def swap_robots(data: Data, random: np.random.Generator) -> bool:
    if len(data["members"]) < 2:
        return False
    one, two = random.choice(len(data["members"]), 2, replace=False)
    rows = data["members"]
    rows[one]["name"], rows[two]["name"] = rows[two]["name"], rows[one]["name"]
    return True


def shift_time(data: Data, random: np.random.Generator) -> bool:
    data[any_of(["since", "until"], random)] += SHIFT * random.choice([-1.0, 1.0])
    return True


EDITS: tuple[Edit, ...] = (
    drop_member,
    drop_edge,
    turn_edge,
    add_edge,
    move_pose,
    move_goal,
    rename_area,
    rename_robot,
    swap_robots,
    shift_time,
)


def sealed_data(data: Data) -> Data:
    """Compute the digest of a certificate anew."""
    said = {key: value for key, value in data.items() if key not in ("digest", "version")}
    return data | {"digest": checker.digest(said)}


def is_refused(folder: Path, data: Data) -> bool:
    """Whether the checker refuses a certificate."""
    try:
        checker.accept(folder, sealed_data(data))
    except REFUSALS:
        return True
    return False


def edited(folder: Path, random: np.random.Generator) -> tuple[str, bool]:
    """Edit the certificate of a folder; say how, and whether it is refused."""
    while True:
        kind = int(random.integers(len(EDITS) + 1))
        data = json.loads((folder / "certificate.json").read_text())
        if kind == len(EDITS):
            return "move_trace", _refused_with_moved_trace(folder, data, random)
        if EDITS[kind](data, random):
            return EDITS[kind].__name__, is_refused(folder, data)


def _refused_with_moved_trace(folder: Path, data: Data, random: np.random.Generator) -> bool:
    """Move a member in the last second of the trace, and in the certificate with it."""
    with zipfile.ZipFile(folder / "trace.zip") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    table = json.loads(files["table.json"])
    row = any_of(data["members"], random)
    pose = np.load(io.BytesIO(files["pose.npy"]))
    last = round(1.0 / table["dt"])
    pose[-last:, table["robots"].index(row["name"]), 0] += SHIFT
    row["pose"][0] += SHIFT
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, pose)
    files["pose.npy"] = buffer.getvalue()
    data["read"] = sha256(b"".join(files[f"{name}.npy"] for name in COLUMNS)).hexdigest()
    with tempfile.TemporaryDirectory() as place:
        shutil.copy(folder / "world.json", place)
        with zipfile.ZipFile(Path(place, "trace.zip"), "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
        return is_refused(Path(place), data)


# --- command line ----------------------------------------------------------------------------


def figures(rows: list[Data]) -> Data:
    """Sum up: how many have a certificate, and why the others have none."""
    kinds: dict[str, list[int]] = collections.defaultdict(lambda: [0, 0])
    for row in rows:
        kinds[row["kind"]][0] += row["certified"]
        kinds[row["kind"]][1] += 1
    return {
        "deadlocks": len(rows),
        "certified": sum(row["certified"] for row in rows),
        "by_kind": dict(sorted(kinds.items())),
        "without": dict(collections.Counter(row["why"] for row in rows if not row["certified"])),
    }


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--kinds", nargs="*", choices=KINDS, help="of cases; all if none")
    parser.add_argument("--first", type=int, default=10_000)
    parser.add_argument("--edits", type=int, default=1_000)
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    root: Path = arguments.output
    root.mkdir(parents=True, exist_ok=True)
    log = root / "rows.jsonl"
    text = log.read_text() if log.is_file() else ""
    known = {row["case"]: row for row in map(json.loads, text.splitlines())}
    with log.open("a") as file:
        kinds = tuple(arguments.kinds or KINDS)
        for name in cases(arguments.rounds, kinds, arguments.first):
            if name not in known:
                known[name] = {"case": name, "row": case_row(name, root)}
                print(json.dumps(codec.encode(known[name])), file=file, flush=True)
    rows = [one["row"] for one in known.values() if one["row"] is not None]
    folders = sorted(root / row["case"].replace("/", "_") for row in rows if row["certified"])
    random, results = np.random.default_rng(0), collections.Counter()
    for _ in range(arguments.edits if folders else 0):
        results[edited(any_of(folders, random), random)] += 1
    found = figures(rows)
    found["edits"] = {name: count for (name, right), count in sorted(results.items()) if right}
    found["edits_accepted"] = {name: n for (name, right), n in sorted(results.items()) if not right}
    print(json.dumps(found, indent=1))
    return 1 if found["edits_accepted"] else 0


if __name__ == "__main__":
    sys.exit(main())
