"""Does one coordinate change only what depends on it?

Run: ``python benchmarks/scenic/nudges.py [PROGRAM ...] [--step 0.1]``

Each coordinate of each program is moved alone from a random point; every property of every object
and every global parameter is compared bit by bit. A part may change only if Scenic's expressions
make it from the coordinate's primitive.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

from scenic.core.distributions import TupleDistribution

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.seeding import stream
from scenic_worlds.primitives.driver import Driver, bits
from scenic_worlds.primitives.plan import NodeRejected
from scenic_worlds.program import compile_program
from scenic_worlds.shipped import scenario_names, scenario_path


def parts_of(driver: Driver) -> dict[str, Any]:
    """Values of the program that scenes have: properties of objects, entries of parameters."""
    parts = {}
    for thing, name in driver.names.items():
        for property_name in thing.properties:
            parts[f"{name}.{property_name}"] = getattr(thing, property_name)
    for name, value in driver.scenario.params.items():
        if name.startswith("_"):
            continue
        entries = value.coordinates if isinstance(value, TupleDistribution) else [value]
        for i, entry in enumerate(entries):
            parts[f"param {name}[{i}]"] = entry
    return parts


def printed(driver: Driver, parts: dict[str, Any], u: Array) -> dict[str, str] | None:
    """Every random part at ``u`` as text; None if the point has no sample."""
    sample = driver.begin()
    try:
        sample.move(u, driver.all_units)
    except NodeRejected:
        return None
    return {name: text_of(sample.values[part]) for name, part in parts.items()}


def text_of(value: Any) -> str:
    """Text that differs if the value does; regions by their outline."""
    if isinstance(value, (tuple, list)):
        return repr([text_of(item) for item in value])
    outline = getattr(value, "polygons", None)
    if outline is not None:
        return str(outline.wkb_hex)
    if hasattr(value, "coordinates"):
        return repr(tuple(value.coordinates))
    if hasattr(value, "q"):
        return repr(value.q.tolist())
    return repr(value) if isinstance(value, (int, float, str, bool)) else type(value).__name__


def main() -> None:
    """Print how many parts moved with each program's coordinates, and how many wrongly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("programs", nargs="*")
    parser.add_argument("--step", type=float, default=0.1)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    total = wrong = 0
    for name in arguments.programs or scenario_names():
        program = compile_program(scenario_path(name))
        driver = program.search.driver
        parts = {key: part for key, part in parts_of(driver).items() if driver.units_of(part)}
        units = {key: set(bits(driver.units_of(part))) for key, part in parts.items()}
        u = program.realise(program.candidate(3)).candidate.u
        steps = stream(3, f"benchmark/nudges/{name}").choice([-1.0, 1.0], len(u))
        before = printed(driver, parts, u)
        assert before is not None
        moved = silent = bad = 0
        for number, unit in enumerate(driver.units):
            for j in range(unit.start, unit.stop):
                nudged = u.copy()
                nudged[j] = (u[j] + steps[j] * arguments.step) % 1.0
                after = printed(driver, parts, nudged)
                if after is None:
                    continue
                changed = {key for key in parts if after[key] != before[key]}
                moved += len(changed)
                silent += not changed
                bad += any(number not in units[key] for key in changed)
        total, wrong = total + len(u), wrong + bad
        print(
            f"{name:24} k {len(u):4}  parts {len(parts):4}  changed per nudge "
            f"{moved / max(len(u), 1):5.1f}  without effect {silent:3}  wrong {bad}",
            flush=True,
        )
    print(f"{total} nudges, {wrong} changed something that does not depend on the coordinate")


if __name__ == "__main__":
    main()
