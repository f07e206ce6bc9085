"""The streams of :mod:`experiments.people.flows`, walked by SUMO's pedestrians as well.

    python -m venv SUMO && SUMO/bin/pip install eclipse-sumo
    python -m experiments.people.sumo --programs SUMO/bin [--seeds N] [--densities D ...]

SUMO (German Aerospace Center, EPL-2.0) simulates traffic; on footpaths its people walk by a model
of stripes, which is its default. The same people start at the same places, with the same speeds
they wish for, along the same corridors: each is a footpath of one edge that both streams use. Its
programs are run on files, so that nothing of SUMO is installed beside this project. Its parameters
are its own but for what a column says: its step, or how many stripes people leave to those who come
towards them.
"""

from __future__ import annotations

import functools
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from experiments.people.flows import (
    LENGTH,
    SETTLING,
    UNTIL,
    Flow,
    measured_flow,
    walkers,
)
from experiments.people.opinions import print_table, stream_arguments
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import HumanSpec

LOOK = 1.0  # s between two measurements, a step of SUMO's own
BEYOND = 40.0  # m that the footpath goes on behind the corridor, so that nobody arrives
HALF = LENGTH / 2.0 + BEYOND  # m

OPTIONS = {
    "SUMO": {"step-length": "1"},
    "SUMO, steps of 0.1 s": {"step-length": "0.1"},
    "SUMO, half the stripes for the others": {
        "step-length": "1",
        "pedestrian.striping.reserve-oncoming": "0.5",
    },
}


def write_footpath(folder: Path, programs: Path, width: float) -> None:
    """Build a straight footpath along x; y is 0 in its middle."""
    nodes = f'<nodes><node id="a" x="{-HALF}" y="0"/><node id="b" x="{HALF}" y="0"/></nodes>'
    edge = f'id="e" from="a" to="b" numLanes="1" speed="3" width="{width}" allow="pedestrian"'
    (folder / "nodes.xml").write_text(nodes)
    (folder / "edges.xml").write_text(f'<edges><edge {edge} spreadType="center"/></edges>')
    _run(programs / "netconvert", "-n", "nodes.xml", "-e", "edges.xml", "-o", "net.xml",
         "--offset.disable-normalization", folder=folder)  # fmt: skip


def write_people(folder: Path, people: list[HumanSpec]) -> None:
    """Write people at their places, each with the speed that it wishes for."""
    root = ElementTree.Element("routes")
    for person in people:
        kind = {"id": f"of_{person.name}", "vClass": "pedestrian", "speedDev": "0"}
        speed = {"maxSpeed": f"{person.speed}", "desiredMaxSpeed": f"{person.speed}"}
        ElementTree.SubElement(root, "vType", kind | speed)
        start, end = person.route
        depart = {"depart": "0", "departPos": f"{start[0] + HALF}", "type": kind["id"]}
        whole = ElementTree.SubElement(root, "person", {"id": person.name} | depart)
        arrive = 1.0 if end[0] < start[0] else 2.0 * HALF - 1.0
        at = {"edges": "e", "arrivalPos": f"{arrive}", "departPosLat": f"{start[1]}"}
        ElementTree.SubElement(whole, "walk", at)
    ElementTree.ElementTree(root).write(folder / "people.xml")


def seen_by(
    programs: Path, options: dict[str, str], width: float, people: list[HumanSpec], seed: int
) -> Iterator[tuple[Array, Array]]:
    """Walk people along a corridor; positions and velocities ``(h, 2)`` while they are measured."""
    given = [word for key, value in options.items() for word in (f"--{key}", value)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_footpath(folder, programs, width)
        write_people(folder, people)
        _run(programs / "sumo", "-n", "net.xml", "-r", "people.xml", "--fcd-output", "seen.xml",
             "--end", str(UNTIL + LOOK), "--seed", str(seed), "--precision", "4", "--no-step-log",
             *given, folder=folder)  # fmt: skip
        seen = ElementTree.parse(folder / "seen.xml").getroot()
    before: Array | None = None
    for moment in seen.iter("timestep"):
        time = float(moment.attrib["time"])
        if time % LOOK or time < SETTLING - LOOK:
            continue
        rows = {row.attrib["id"]: row.attrib for row in moment.iter("person")}
        order = [rows[person.name] for person in people]
        now = np.array([(float(row["x"]), float(row["y"])) for row in order])
        if before is not None:
            yield now, (now - before) / LOOK
        before = now


def _run(*command: Path | str, folder: Path) -> None:
    subprocess.run(list(map(str, command)), cwd=folder, check=True, stdout=subprocess.DEVNULL)


def theirs(
    density: float,
    width: float,
    *,
    programs: Path,
    options: dict[str, str],
    both_ways: bool,
    seed: int,
) -> Flow:
    """Measure one stream of SUMO."""
    people = walkers(density, width, both_ways=both_ways, seed=seed)
    seen = seen_by(programs, options, width, people, seed)
    return measured_flow(density, width, people, seen)


def main() -> None:
    """Print the table."""
    parser = stream_arguments(__doc__)
    parser.add_argument("--programs", type=Path, required=True, help="folder of sumo, netconvert")
    arguments = parser.parse_args()
    programs = arguments.programs.resolve()
    columns = {
        name: functools.partial(theirs, programs=programs, options=options)
        for name, options in OPTIONS.items()
    }
    print_table(columns, arguments)


if __name__ == "__main__":
    main()
