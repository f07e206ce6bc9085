"""Robots lock areas before they enter them.

``mode``: *hold* locks one area after the other, keeps what it has and waits for the next. *atomic*
takes all areas of its path at once or none. *ordered* takes them in one order that all robots
share. *timeout* is *hold*, but a robot that has waited for ``patience`` s gives way to those before
it in the list: it lets go of what it has until they have passed.

``keep``: an area is let go behind it, or (1) only at the next stop.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from driving import Drivers, Reason
from mrta_stack import serve


class Locks(Drivers):
    """See the module."""

    def __init__(self, world: dict[str, Any], harness: Any) -> None:
        super().__init__(world, harness)
        params = self.params
        self.mode, self.before = params["mode"], float(params["before"])
        self.keep, self.patience = bool(params.get("keep")), float(params.get("patience", 1e9))
        self.areas = {
            area["name"]: np.array(area["release_area"])
            for area in world["resources"]
            if area["kind"] != "room"
        }
        self.owner: dict[str, int | None] = dict.fromkeys(self.areas)
        self.waits_since: list[float | None] = [None] * self.count
        self.gave_way: list[Any] = [None] * self.count
        self._crossed: list[Any] = [(None, [])] * self.count

    def arrived(self, i: int) -> None:
        """Let go of all areas at a stop."""
        self._let_go(i)

    def _let_go(self, i: int) -> None:
        for area, owner in self.owner.items():
            if owner == i:
                self.owner[area] = None

    def may_go(self, i: int, pose: Any) -> Reason | None:
        """Lock what lies ahead."""
        crossed, k = self._areas_on_path(i), self.place[i]
        if not self.keep:
            for area, owner in self.owner.items():
                if owner == i and not any(area in here for here in crossed[k:]):
                    self.owner[area] = None
        if self._has_given_way(i):
            return Reason("lock", (self.gave_way[i][1],))
        reach = k + round(self.before / 0.1) + 1
        near = _distinct(crossed[k:reach])
        whole = _distinct(crossed[k:])
        if self.mode in ("atomic", "ordered") and any(self.owner[area] != i for area in near):
            near = sorted(whole) if self.mode == "ordered" else whole
        held_by = self._ask(i, near)
        if held_by is None:
            self.waits_since[i] = None
            return None
        if self.waits_since[i] is None:
            self.waits_since[i] = self.time
        if self.mode == "timeout" and self.time - self.waits_since[i] > self.patience:
            self._give_way(i, held_by)
        return Reason("lock", (self.owner[held_by],)) if self.owner[held_by] is not None else None

    def _ask(self, i: int, areas: list[str]) -> str | None:
        """Lock areas; name the first one that another robot has."""
        taken = [area for area in areas if self.owner[area] not in (None, i)]
        if self.mode == "atomic" and taken:
            return taken[0]
        for area in areas:
            if self.owner[area] is None:
                self.owner[area] = i
                self.events.append({"kind": "granted", "robot": i, "resource": area})
            elif self.owner[area] != i and self.mode == "ordered":
                return area
        return taken[0] if taken else None

    def _give_way(self, i: int, area: str) -> None:
        """Let go of everything for a robot that stands before this one in the list."""
        owner = self.owner[area]
        if owner is not None and owner < i:
            self._let_go(i)
            self.gave_way[i], self.waits_since[i] = (area, owner), None

    def _has_given_way(self, i: int) -> bool:
        """Whether a robot still waits for the area that it has given way for."""
        if self.gave_way[i] is None:
            return False
        area, owner = self.gave_way[i]
        if self.owner[area] == owner:
            return True
        self.gave_way[i] = None
        return False

    def _areas_on_path(self, i: int) -> list[list[str]]:
        """Areas at each point of a path."""
        known, crossed = self._crossed[i]
        if known is not self.path[i]:
            path = self.path[i]
            inside = {name: _inside(path, area) for name, area in self.areas.items()}
            crossed = [[name for name in self.areas if inside[name][k]] for k in range(len(path))]
            self._crossed[i] = (path, crossed)
        return crossed


def _distinct(rows: list[list[str]]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row))


def _inside(points: Any, polygon: Any) -> Any:
    """Which points lie in a polygon (crossings of a ray)."""
    x, y = points.T
    found = np.zeros(len(points), dtype=bool)
    for (x1, y1), (x2, y2) in zip(polygon, np.roll(polygon, 1, axis=0), strict=True):
        if y1 != y2:
            crosses = ((y1 > y) != (y2 > y)) & (x < (x2 - x1) * (y - y1) / (y2 - y1) + x1)
            found ^= crosses
    return found


if __name__ == "__main__":
    serve(Locks, name="locks", version="1", says=("deliveries", "goals", "paths"))
