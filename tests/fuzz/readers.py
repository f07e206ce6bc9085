"""Many damaged inputs for every reader: ``python -m tests.fuzz.readers --n 50000 --seed 1``.

What leaves a reader is sound, or an InputError of one sentence. A case depends on its seed and
number only, and is made again by ``--first NUMBER --n 1``.
"""

from __future__ import annotations

import argparse
import collections
import hashlib
import json
import random
import re
import signal
import sys
import tempfile
import traceback
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.finding_files import FILE_NAMES, read_finding
from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.campaigns.store import read_campaign
from mrta_falsify.commands.ci.ledger import Ledger
from mrta_falsify.commands.ci.project import ProjectFile
from mrta_falsify.commands.stored_trials import trial_rows
from mrta_falsify.core import codec, trace
from mrta_falsify.core.config import StackConfig, apply_setting, read_config
from mrta_falsify.core.errors import InputError, InputNote
from mrta_falsify.core.findings import Certificate, Explanation, Minimisation, ReplayCheck
from mrta_falsify.core.record import PerturbedRuns, TrialRecord
from mrta_falsify.core.world import World, read_world
from mrta_falsify.specs.library import specification_choice
from scenic_worlds.zoo import SceneFile
from simulator_interface.engines.robot_models import RobotModel
from simulator_interface.external import transcript
from simulator_interface.external.answers import Reader, Wrong
from simulator_interface.foreign.dds.bridge_settings import BridgeSettings
from simulator_interface.foreign.ros_nodes.launching import LaunchFile
from simulator_interface.formats import mrta_sim, nav2
from simulator_interface.formats.floor_yaml import FloorFile
from tests.fuzz.texts import SCALARS, damaged_json, damaged_yaml
from tests.fuzz.values import at, sites, spoiled, valid

RECORDED = Path(__file__).parents[1] / "recorded" / "campaigns"
MAX_CPU = 10.0  # s of one case
MAX_TEXT = 2000  # characters of one sentence

#: whatever a file of ours or of others is decoded as
ROOTS: tuple[type, ...] = (
    *(World, StackConfig, TrialRecord, CampaignSettings, Explanation, Minimisation, ReplayCheck),
    *(Certificate, Ledger, ProjectFile, SceneFile, RobotModel, BridgeSettings, LaunchFile),
    *(
        FloorFile,
        PerturbedRuns,
        trace._Table,
        transcript._Head,
        mrta_sim.TaskFile,
        mrta_sim._Setup,
    ),
    *(mrta_sim._Route, nav2._Description),
)


class Found(AssertionError):
    """A case was not answered as it must be."""


def refused(read: Callable[[], Any], what: str) -> None:
    """Read what must be refused."""
    if not answered(read):
        raise Found(f"accepted: {what}"[:500])


def answered(read: Callable[[], Any]) -> bool:
    """Read; say whether it was refused, in one sentence."""
    try:
        read()
    except (InputError, Wrong) as error:
        text = str(error)
        if not text or len(text) > MAX_TEXT or "Traceback" in text:
            raise Found(f"no sentence: {text[:300]!r}") from None
        text.encode()  # a terminal must be able to show it
        return True
    return False


# --- kinds of cases ----------------------------------------------------------------------------


def valid_data(rnd: random.Random, folder: Path) -> None:
    """Data within all rules is decoded, or its parts do not fit; it survives a round trip."""
    del folder
    root = rnd.choice(ROOTS)
    data = valid(root, None, rnd)
    try:
        value = codec.decode(root, data, where="file")
    except InputError:
        return  # a contradiction between parts
    text = codec.canonical_json(value)
    again = codec.decode(root, json.loads(text), where="file")
    if codec.canonical_json(again) != text:
        raise Found(f"{root.__name__} differs after a round trip: {text[:200]}")


def spoiled_data(rnd: random.Random, folder: Path) -> None:
    """One mistake anywhere is refused, and the message names the file."""
    del folder
    root = rnd.choice(ROOTS)
    data, site = spoiled(root, rnd)
    what = f"{root.__name__}.{'.'.join(map(str, site.path))} is {codec.shown(at(data, site.path))}"
    refused(lambda: codec.decode(root, data, where="file"), what)


def swapped_data(rnd: random.Random, folder: Path) -> None:
    """Parts of valid data in each other's places are decoded or refused."""
    del folder
    root = rnd.choice(ROOTS)
    data, other = (valid(root, None, rnd) for _ in range(2))
    places, others = sites(root, None, data), sites(root, None, other)
    path = rnd.choice(places).path
    part = at(other, rnd.choice(others).path)
    if path:
        at(data, path[:-1])[path[-1]] = part
    answered(lambda: codec.decode(root, data, where="file"))


def json_text(rnd: random.Random, folder: Path) -> None:
    """Damaged JSON is parsed and decoded, or refused."""
    _text(rnd, folder / "file.json", damaged_json, codec.read_json)


def yaml_text(rnd: random.Random, folder: Path) -> None:
    """Damaged YAML is parsed and decoded, or refused."""
    _text(rnd, folder / "file.yaml", damaged_yaml, codec.read_yaml)


def _text(
    rnd: random.Random,
    path: Path,
    damaged: Callable[[Any, random.Random], tuple[str, bool]],
    parsed: Callable[[Path], Any],
) -> None:
    root = rnd.choice(ROOTS)
    text, must = damaged(valid(root, None, rnd), rnd)
    path.write_text(text, encoding="utf-8")
    read = lambda: codec.decode(root, parsed(path), where="file")  # noqa: E731
    if must:
        refused(read, text)
    else:
        answered(read)


def command_line(rnd: random.Random, folder: Path) -> None:
    """Values of ``--set`` and options of ``--spec`` are taken or refused."""
    del folder
    value = rnd.choice([*SCALARS, "[" * 2000, "{a: " * 400, "&a [*a]", "a" * 5000, "\x00"])
    key = rnd.choice(["control_rate", "planner", "planner.tolerance", "defects", "engine", "x.y"])
    answered(lambda: apply_setting(StackConfig(), f"{key}={value}"))
    answered(lambda: specification_choice(f"costly_way{{factor: {value}}}"))


def stack_file(rnd: random.Random, folder: Path) -> None:
    """A stack's file is read as a whole."""
    text, _ = damaged_yaml(valid(StackConfig, None, rnd), rnd)
    (folder / "s.yaml").write_text(text, encoding="utf-8")
    answered(lambda: read_config(folder / "s.yaml"))


def world_file(rnd: random.Random, folder: Path) -> None:
    """A recorded world with one part of another one."""
    data = json.loads((RECORDED / "beds/trials/0003/world.json").read_text())
    places = sites(World, None, data)
    site = rnd.choice(places)
    if site.path:
        odd = valid(rnd.choice(ROOTS), None, rnd) if rnd.random() < 0.5 else 1e308
        at(data, site.path[:-1])[site.path[-1]] = odd
    text, must = damaged_json(data, rnd) if rnd.random() < 0.5 else (json.dumps(data), False)
    (folder / "world.json").write_text(text, encoding="utf-8")
    read = lambda: read_world(folder / "world.json")  # noqa: E731
    if must:
        refused(read, text[:100])
    else:
        answered(read)


def campaign(rnd: random.Random, folder: Path) -> None:
    """A record with a right checksum and another content is told or left out, by name."""
    source = RECORDED / rnd.choice(["beds", "stalls"])
    (folder / "campaign.json").write_bytes((source / "campaign.json").read_bytes())
    lines = (source / "records.jsonl").read_text().splitlines()
    i = rnd.randrange(len(lines))
    data = json.loads(lines[i].split("\t", 1)[1])
    spots = list(_nodes(data))
    path = rnd.choice(spots)
    if path:
        at(data, path[:-1])[path[-1]] = rnd.choice(
            [None, True, "x", -1, 1e308, [], {}, [1], {"robot": 3}, ["a"], 10**400, "x" * 9000]
        )
    text = damaged_json(data, rnd)[0] if rnd.random() < 0.3 else json.dumps(data)
    text = text.replace("\n", " ")
    checksum = hashlib.sha256(text.encode()).hexdigest()[:16]
    lines[i] = f"{checksum}\t{text}"
    (folder / "records.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    answered(lambda: trial_rows(read_campaign(folder)))
    answered(lambda: read_campaign(folder).frame() if rnd.random() < 0.1 else None)


def _nodes(data: Any, path: tuple[Any, ...] = ()) -> Any:
    yield path
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, item in items if isinstance(data, (dict, list)) else ():
        if isinstance(item, (dict, list)):
            yield from _nodes(item, (*path, key))
        else:
            yield (*path, key)


def archive(rnd: random.Random, folder: Path) -> None:
    """A trace with another table, or an array with another header."""
    source = RECORDED / "stalls/trials/0000/trace.min.zip"
    with zipfile.ZipFile(source) as opened:
        members = {name: opened.read(name) for name in opened.namelist()}
    if rnd.random() < 0.5:
        data = json.loads(members["table.json"])
        path = rnd.choice(list(_nodes(data))[:500])
        if path:
            at(data, path[:-1])[path[-1]] = rnd.choice([None, True, "x", -1, 1e308, [], {}, [1]])
        members["table.json"] = damaged_json(data, rnd)[0].encode()
    else:
        name = rnd.choice([name for name in members if name.endswith(".npy")])
        shape = rnd.choice(
            ["(10**12,)", "(1000000000000,)", "(-1,)", "(99999, 99999)", "()", "[", "(511,)"]
        )
        kind = rnd.choice(["<f8", "|O", "<U9", ">f8", "|V8", "|b1", "<c16"])
        head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
        head += b" " * (-(len(head) + 11) % 64) + b"\n"
        members[name] = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(64)
    with zipfile.ZipFile(folder / "trace.zip", "w") as made:
        for name, body in members.items():
            made.writestr(name, body)
    answered(lambda: trace.read_trace(folder / "trace.zip"))


def finding(rnd: random.Random, folder: Path) -> None:
    """A finding of another shape."""
    kind = rnd.choice(list(FILE_NAMES))
    text, _ = damaged_json(valid(kind, None, rnd), rnd)
    (folder / FILE_NAMES[kind]).write_text(text, encoding="utf-8")
    answered(lambda: read_finding(folder, kind))


def journal(rnd: random.Random, folder: Path) -> None:
    """A damaged row of a journal costs one run."""
    row = {"version": 2, "kind": "PerturbedRuns", "code": "c", "run": "k"}
    row["answer"] = valid(PerturbedRuns, None, rnd)
    row[rnd.choice(list(row))] = rnd.choice([[], {}, None, 10**400, ["a"], {"runs": "x"}])
    text = damaged_json(row, rnd)[0].replace("\n", " ") + "\n"
    (folder / "a.jsonl").write_text(text, encoding="utf-8")
    RunJournal(PerturbedRuns, folder / "a.jsonl", code="c")


def command(rnd: random.Random, folder: Path) -> None:
    """An answer of a foreign stack."""
    del folder
    message: dict[str, Any] = {"type": "command", "tick": 3, "twist": [[0.0, 0.0, 0.0]] * 2}
    message["paths"] = [[0, [[0.0, 0.0], [1.0, 1.0]]]]
    message["waits_for"] = [[0, "room"]]
    message["signals"] = {"a": 1.0}
    message["events"] = [{"kind": "picked-up", "robot": 0, "task": 0}]
    message |= {"slack": [0.0, None], "stops_left": [1, 2], "took": 0.1, "goal": [[0.0, 1.0]] * 2}
    path = rnd.choice(list(_nodes(message))[1:])
    at(message, path[:-1])[path[-1]] = rnd.choice(
        [
            None,
            True,
            "1",
            -1,
            1e308,
            [],
            {},
            [1],
            [[True]],
            10**400,
            b"abc",
            float("nan"),
            ["x"] * 3,
        ]
    )
    answered(lambda: Reader(("r1", "r2"), 2).read(message, 3, 0.1))


CASES: tuple[tuple[Callable[[random.Random, Path], None], int], ...] = (
    *((valid_data, 4), (spoiled_data, 20), (swapped_data, 4), (json_text, 6), (yaml_text, 3)),
    *((command_line, 1), (stack_file, 1), (world_file, 1), (campaign, 2), (archive, 1)),
    *((finding, 2), (journal, 2), (command, 5)),
)
_KINDS = [kind for kind, weight in CASES for _ in range(weight)]


def run_case(seed: int, number: int, folder: Path) -> str:
    """Run one case; give its kind.

    Raises:
        Exception: it was not answered as it must be.
    """
    rnd = random.Random(f"{seed}/{number}")
    kind = rnd.choice(_KINDS)
    for file in folder.iterdir():
        file.unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputNote)
        kind(rnd, folder)
    return kind.__name__


def main() -> int:
    """Run many cases; print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    counts: collections.Counter[str] = collections.Counter()
    found: collections.Counter[str] = collections.Counter()

    def too_long(*_: object) -> None:
        raise Found(f"took over {MAX_CPU:g} s of CPU time")

    signal.signal(signal.SIGPROF, too_long)
    with tempfile.TemporaryDirectory() as name:
        for number in range(given.first, given.first + given.n):
            signal.setitimer(signal.ITIMER_PROF, MAX_CPU)
            try:
                counts[run_case(given.seed, number, Path(name))] += 1
            except Exception as error:
                where = traceback.extract_tb(error.__traceback__)[-1]
                text = re.sub(r"\d+", "#", str(error))[:70]
                key = f"{type(error).__name__} in {Path(where.filename).name}:{where.name} {text}"
                if not found[key]:
                    print(f"case {number}: {type(error).__name__}: {str(error)[:400]}", flush=True)
                found[key] += 1
            signal.setitimer(signal.ITIMER_PROF, 0)
    print(f"{sum(counts.values())} answered ({dict(counts)}), {sum(found.values())} not")
    for key, count in found.most_common():
        print(f"{count:6} {key}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
