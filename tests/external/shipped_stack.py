"""The shipped stack as a foreign stack; parameters: files of world and stack."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mrta_falsify.core.config import read_config
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.fleet import FleetState
from mrta_falsify.core.world import read_world
from mrta_falsify.stack.pipeline import Stack
from simulator_interface.clients.mrta_stack import Harness, serve


class Maps:
    """Costmaps as the harness has them."""

    def __init__(self, harness: Harness) -> None:
        self._harness = harness
        self._known: dict = {}
        self._map: Costmap | None = None

    def costmap(self, time: float, parked: np.ndarray) -> Costmap:
        found = self._harness.map(parked)
        if found is not self._known:
            self._known = found
            self._map = Costmap(found["cost"], found["resolution"], np.array(found["origin"]))
        return self._map


class Shipped:
    """Wraps the shipped stack."""

    def __init__(self, world: dict, harness: Harness) -> None:
        files = world["params"]
        self._stack = Stack(
            read_world(Path(files["world"])), read_config(Path(files["stack"])), Maps(harness)
        )
        self._state = self._stack.start()
        self._paths: tuple = ()
        self._is_closed = False

    def step(self, tick: dict) -> dict:
        if tick["closed"] and not self._is_closed:
            self._is_closed = True
            self._stack.forget_after(self._state, tick["time"] - 1e-6)
        names = FleetState.__slots__
        fleet = FleetState(**{name: tick[name] for name in names})
        self._state, command, intent, events = self._stack.step(self._state, fleet)
        before = self._paths or (None,) * len(intent.path)
        self._paths = intent.path
        changed = [
            [i, path]
            for i, (path, known) in enumerate(zip(intent.path, before, strict=True))
            if path is not known
        ]
        said = {
            "twist": command.twist,
            "goal": intent.goal,
            "waypoint": intent.waypoint,
            "slack": intent.slack,
            "stops_left": intent.tasks_left.tolist(),
            "paths": changed,
            "waits_for": [[i, what] for i, what in enumerate(intent.waits_for) if what],
            "events": [
                {
                    "kind": e.kind,
                    "robot": e.robot,
                    "task": e.task,
                    "resource": e.resource,
                    "other": e.other,
                    "detail": e.detail,
                }
                for e in events
            ],
        }
        for name in ("phase", "cluster", "leader", "queue"):
            said[name] = getattr(intent, name).tolist()
        return said


if __name__ == "__main__":
    serve(Shipped, name="shipped", says=("deliveries", "goals", "paths"))
