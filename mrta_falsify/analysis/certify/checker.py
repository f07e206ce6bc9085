"""Check the certificate of a deadlock from World and trace; needs Python and numpy only.

    python checker.py FOLDER     # of a trial: world.json, trace.zip, certificate.json

Members stand, each for one reason. With `area` it asked for that resource or has its goal there,
and the named robots fill it. Else no way leads to its goal past solids and the named robots.
Assumed: robots are discs, those without work stay, nobody enters full areas, goals are as told.
"""

import io
import json
import sys
import zipfile
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

STANDS, LEAST, CELL = 0.05, 2.0, 0.03  # m to stay within; s to have stood at least; m of the grid
REACH, SAME, RIM = 0.5 + CELL, 1e-6, 0.1  # m; so near its goal one is served; equal; free rim
KINDS = ("waits-for", "granted", "released")


def check(condition: Any, why: str) -> None:
    """Refuse unless the condition holds."""
    if not condition:
        raise ValueError(f"refused: {why}")


def digest(value: Any) -> str:
    """Compute the sha256 of canonical JSON."""
    return sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def distance(outline: Any, x: Any, y: Any) -> Any:
    """Measure from points to a polygon [m]; 0 inside."""
    best, inside = x + y + np.inf, x + y > np.inf
    for a, b in zip(np.roll(outline, 1, axis=0), np.asarray(outline), strict=True):
        d = b - a
        t = np.clip(((x - a[0]) * d[0] + (y - a[1]) * d[1]) / max(d @ d, 1e-18), 0.0, 1.0)
        best = np.minimum(best, np.hypot(a[0] + t * d[0] - x, a[1] + t * d[1] - y))
        if d[1]:
            inside ^= ((a[1] > y) != (b[1] > y)) & (x < a[0] + (y - a[1]) * d[0] / d[1])
    return np.where(inside, 0.0, best)


def reached(free: Any, start: tuple[int, ...]) -> Any:
    """Fill the cells that hang together with ``start``, corners included."""
    seen, count = np.zeros_like(free), -1
    seen[start] = True
    both = [(seen, free), (seen.T, free.T)]
    ids = [np.cumsum(~f, 1) + (f.shape[1] + 1) * np.arange(len(f))[:, None] for _, f in both]
    while count != (count := int(seen.sum())):
        for (part, cells), stretch in zip(both, ids, strict=True):
            hit = np.bincount(stretch[part], minlength=stretch.max() + 1) > 0
            part[cells & hit[stretch]] = True
        for to, of in ((np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:])):
            seen[1:, to] |= seen[:-1, of] & free[1:, to]
            seen[:-1, to] |= seen[1:, of] & free[:-1, to]
    return seen


class Case:
    """World and trace; ``at`` and ``goal`` are those at the end of the trace."""

    def __init__(self, folder: Path) -> None:
        self.world = w = json.loads((folder / "world.json").read_text())
        with zipfile.ZipFile(folder / "trace.zip") as archive:
            raw = [archive.read(f"{k}.npy") for k in ("time", "pose", "goal", "tasks_left")]
            self.table = json.loads(archive.read("table.json"))
        self.read = sha256(b"".join(raw)).hexdigest()
        self.time, pose, self.goals, self.left = (np.load(io.BytesIO(data)) for data in raw)
        self.poses, self.at, self.goal = pose[..., :2], pose[-1, :, :2], self.goals[-1]
        self.sure = min(r["radius"] for r in w["robots"]) - 0.7072 * CELL  # a cell's middle to edge
        self.low, high = np.reshape(w["bounds"], (2, 2)) + np.array([[-RIM], [RIM]])
        x, y = (np.arange(self.low[k] + CELL / 2, high[k], CELL) for k in (0, 1))
        self.x, self.y, self.free = x[:, None], y[None, :], np.ones((len(x), len(y)), bool)
        solids = w["walls"] + [item for item in w["furniture"] if not item.get("movable")]
        for e in (e for e in w["events"] if e["kind"] == "blockage" and e["end"] >= w["horizon"]):
            clear = distance(e["polygon"], *self.at.T).min() > self.sure + CELL  # or not there
            solids += [e] if clear and e["start"] < self.time[-1] else []
        for solid in (np.array(solid["polygon"]) for solid in solids):
            ends = np.array([solid.min(axis=0) - self.sure, solid.max(axis=0) + self.sure + CELL])
            i, k = (slice(*pair) for pair in ((ends - self.low) / CELL).astype(int).clip(0).T)
            self.free[i, k] &= distance(solid, self.x[i], self.y[:, k]) > self.sure

    def has_way(self, who: int, others: list[int]) -> bool:
        """Whether cells that are not blocked as a whole lead a disc's centre to its goal."""
        free, (x, y) = self.free, self.goal[who]
        for x0, y0 in self.at[others]:
            free = free & (np.hypot(self.x - x0, self.y - y0) > 2.0 * self.sure)
        start = tuple(((self.at[who] - self.low) / CELL).astype(int).tolist())
        check(free[start], "a member touches something")
        return bool((reached(free, start) & (np.hypot(self.x - x, self.y - y) < REACH)).any())

    def since(self, robots: list[int]) -> Any:
        """Tell from when on robots stand, with one goal [s]."""
        moves = np.hypot(*(self.poses - self.at)[:, robots].T) > STANDS
        other = ~np.isclose(self.goals, self.goal, rtol=0, atol=SAME, equal_nan=True)[:, robots]
        changes = np.flatnonzero(moves.any(axis=0) | other.any(axis=(1, 2)))
        return self.time[changes[-1] + 1 if len(changes) else 0]

    def fills(self, who: int, name: str, robots: list[int]) -> bool:
        """Whether robots fill an area in which another one wants to be."""
        area = next(r for r in self.world["resources"] if r["name"] == name)
        room = [] if area["room"] is None else self.world["rooms"][area["room"]]["area"]
        outline, told = room or area["release_area"], self.table["events"]
        told = [e["kind"] for e in told if (e["robot"], e["resource"]) == (who, name)]
        asked = [kind for kind in told if kind in KINDS][-1:] == ["waits-for"]
        inside = distance(outline, *self.at.T) == 0
        full = len(robots) == area["capacity"] and inside[robots].all() and not inside[who]
        return bool(full and (asked or not distance(outline, *self.goal[who])))


def accept(folder: Path, given: Any) -> None:
    """Raise a ValueError unless a certificate follows from the files of its folder."""
    case, own = Case(folder), {k: given[k] for k in given if k not in ("digest", "version")}
    check(given["digest"] == digest(own), "its digest is another one")
    check(given["world"] == digest(case.world) == case.table["world_digest"], "of another world")
    check([given["trace"], given["read"]] == [case.table["digest"], case.read], "of another trace")
    names, rows = [r["name"] for r in case.world["robots"]], given["members"] + given["resting"]
    robots = [names.index(row["name"]) for row in rows]
    members, waits = set(robots[: len(given["members"])]), {k: set[int]() for k in robots}
    check(members and len(waits) == len(rows), "names no robot, or one twice")
    span = [case.since(robots), case.time[-1]]
    right = np.allclose(span, [given["since"], given["until"]], rtol=0, atol=SAME)
    check(right and span[1] - span[0] >= LEAST, f"they stand from and to {span} s")
    for k, row in zip(robots, rows, strict=True):
        check(np.allclose(row["pose"], case.at[k], rtol=0, atol=SAME), "a robot stands elsewhere")
        if k not in members:
            check(np.isnan(case.goal[k]).all() and case.left[-1, k] == 0, "a robot has work")
            continue
        check(np.allclose(row["goal"], case.goal[k], rtol=0, atol=SAME), "a goal is another one")
        others = [names.index(name) for name in row["robots"]]
        waits[k], area = set(others) & set(robots) - {k}, row["area"]
        held = case.fills(k, area, others) if area else not case.has_way(k, others)
        check(held and len(waits[k]) == len(others), "a member need not wait for those it names")
        for j in () if area else others:
            check(case.has_way(k, [m for m in others if m != j]), "a robot is named in vain")
    for k in members:
        after = waits[k] | (members if len(members) == 1 else set())
        for _ in members:
            after = after.union(*(waits[j] for j in after))
        check(after == set(robots), "no closed circle")


if __name__ == "__main__":
    accept(Path(sys.argv[1]), json.loads(Path(sys.argv[1], "certificate.json").read_text()))
    print("accepted")
