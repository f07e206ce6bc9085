"""A hall of 10 m by 6 m on which the planning service plans."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrta_falsify.core.costmap import LETHAL, Costmap
from mrta_falsify.stack.planning.astar import AStar
from mrta_falsify.stack.planning_service import PlanningService, ServiceState
from mrta_falsify.stack.route import Way

PARKED_RADIUS = 0.22  # m, of a robot at rest on the map
BEFORE, BEHIND = np.array([1.0, 0.0]), np.array([9.0, 0.0])  #: at the ends of its axis [m]


def hall(width: float = 6.0, solids: Sequence[tuple[float, float, float, float]] = ()) -> Costmap:
    """The hall, free up to ``width`` / 2 beside its axis, with boxes x1, y1, x2, y2 [m] in it."""
    cost = np.zeros((60, 100), dtype=np.uint8)
    y = -3.0 + 0.1 * (np.arange(60) + 0.5)
    cost[np.abs(y) > 0.5 * width] = LETHAL
    costmap = Costmap(cost, 0.1, np.array([0.0, -3.0]))
    for x1, y1, x2, y2 in solids:
        (row, col), (last_row, last_col) = costmap.cells(np.array([[x1, y1], [x2, y2]]))
        cost[row:last_row, col:last_col] = LETHAL
    return costmap


class _Map:
    def __init__(self, costmap: Costmap) -> None:
        self._costmap = costmap

    def costmap(self, time: float, parked: np.ndarray) -> Costmap:
        known = self._costmap
        cells = np.argwhere(np.ones(known.cost.shape, dtype=bool))
        apart = np.linalg.norm(known.centers(cells)[:, None] - parked[None], axis=2)
        cost = known.cost.copy()
        cost[tuple(cells[(apart < PARKED_RADIUS).any(axis=1)].T)] = LETHAL
        return Costmap(cost, known.resolution, known.origin)


def planned(
    costmap: Costmap,
    start: object,
    route: object,
    *,
    rooms: Sequence[np.ndarray] = (),
    not_held: Sequence[int] = (),
    parked: Sequence[tuple[float, float]] = (),
) -> Way:
    """The way from ``start`` through ``route``, planned by A*; robots are at rest at ``parked``."""
    service = PlanningService(AStar(AStar.Options()), _Map(costmap), rooms=rooms)
    way = Way().head_for(np.array(route, dtype=float))
    state = ServiceState()
    if parked:
        state.note_parked(np.array(parked), np.full(len(parked), np.inf))
    return service.plan(state, way, np.array(start, dtype=float), 0.0, not_held)
