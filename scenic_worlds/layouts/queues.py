"""Where robots wait and park on any floor: along walls, out of the traffic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import Polygon

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from scenic_worlds.layouts.entrances import Entrance
from scenic_worlds.layouts.frontages import SPOT_STEP
from scenic_worlds.layouts.routes import RouteMap

SPOT_GAP = (0.40, 0.60)  # m, waiting robot to the wall beside it
LEAST_STEP = 0.95
FROM_FRONT = (0.95, 2.6)  # m, front of the door to the head spot, straight
TO_LANE = 0.75  # m, waiting robot to a lane
BETWEEN_LANES = 0.78  # m, as AWS
TO_WALL = 0.42  # m, lane to a wall
FACING = 0.8  # m; spots across a corridor face each other if they are no farther aside
NO_TRAFFIC = 1.3  # m from every middle way: no traffic passes there
OFF_AREA = 0.25  # m between a spot and what other rooms need
PARK_APART = 1.1  # m, parked robot to other places
PARK_TO_LANE, PARK_WITHIN = 0.9, 4.0  # m, parked robot to the nearest lane
SAMPLES = 0.1  # m between places that are considered


@dataclass(frozen=True, slots=True, eq=False)
class Sites:
    """Places where a robot could stand, with what matters about each."""

    points: Array  #: (n, 2) [m]
    away: Array  #: (n, 2) unit vector away from the wall
    beside: Array  #: (n,) free width from the place on, away from the wall [m]
    traffic: Array  #: (n,) distance to the nearest middle way [m]

    def taking(self, keep: BoolArray) -> Sites:
        """Keep some of the places."""
        return Sites(self.points[keep], self.away[keep], self.beside[keep], self.traffic[keep])


def standing_places(
    routes: RouteMap, entrances: list[Entrance], middles: BoolArray, part: int
) -> Sites:
    """Find all places along walls outside rooms and door aprons.

    Args:
        routes: the floor.
        entrances: of all rooms.
        middles: ``(rows, cols)`` cells of all middle ways.
        part: connected part of the floor that robots are on.
    """
    low, high = (gap + routes.extra for gap in SPOT_GAP)
    standing = (routes.part == part) & (routes.clearance >= low) & (routes.clearance <= high)
    stride = max(1, round(SAMPLES / routes.resolution))
    coarse = np.zeros_like(standing)
    coarse[::stride, ::stride] = True
    cells = np.argwhere(standing & coarse)
    points = routes.costmap.centers(cells)
    keep = np.ones(len(points), dtype=np.bool_)
    for entrance in entrances:
        for ring in (entrance.release_area, entrance.area, entrance.inside):
            if not len(ring):
                continue
            low_corner, high_corner = ring.min(axis=0) - OFF_AREA, ring.max(axis=0) + OFF_AREA
            around = ((points >= low_corner) & (points <= high_corner)).all(axis=1)
            around = np.flatnonzero(around & keep)
            near = shapely.dwithin(Polygon(ring), shapely.points(points[around]), OFF_AREA)
            keep[around[near]] = False
    cells, points = cells[keep], points[keep]
    smooth = ndimage.gaussian_filter(routes.clearance, 1.5)
    slope = np.stack(np.gradient(smooth)[::-1], axis=-1)[cells[:, 0], cells[:, 1]]
    length = np.hypot(*slope.T) if len(slope) else np.zeros(0)
    keep = length > 0.3 * routes.resolution
    cells, points = cells[keep], points[keep]
    away = slope[keep] / length[keep][:, None]
    traffic = routes.distance_to_cells(middles)[cells[:, 0], cells[:, 1]]
    return Sites(points, away, _free_width(routes, points, away), traffic)


def _free_width(routes: RouteMap, points: Array, away: Array) -> Array:
    """Measure the way ``(n,)`` [m] to the next solid in direction ``away``, at most 3 m."""
    width = np.full(len(points), 3.0)
    for reach in np.arange(3.0, 0.2, -routes.resolution):
        blocked = routes.gap(points + reach * away) <= 0.0
        width = np.where(blocked, reach, width)
    return width


def choose_queue(
    routes: RouteMap,
    sites: Sites,
    entrance: Entrance,
    taken: Array,
    wanted: int,
) -> Array:
    """Choose the waiting spots of one room, head first; as many as there is room for.

    The row upstream of the door is preferred: beside the lane that leads to it, with the
    wall on the right of who drives there.

    Args:
        routes: the floor.
        sites: places to choose from.
        entrance: of the room.
        taken: ``(K, 2)`` places that others need [m].
        wanted: how many.

    Returns:
        ``(S, 2)`` spots [m], S <= wanted.
    """
    farther = 2.0 * routes.extra  # between two robots
    reach = FROM_FRONT[1] + wanted * (SPOT_STEP + farther) * 1.3
    far = np.hypot(*(sites.points - entrance.front).T)
    sites = sites.taking((far >= FROM_FRONT[0] + farther) & (far <= reach))
    quiet = sites.traffic >= NO_TRAFFIC + farther
    near = np.ones(len(sites.points), dtype=np.bool_)
    opposite = np.full(len(near), np.inf)
    if len(taken) and len(near):
        gap = taken[None] - sites.points[:, None]
        near &= np.hypot(gap[..., 0], gap[..., 1]).min(axis=1) >= LEAST_STEP + farther
        across = (gap * sites.away[:, None]).sum(axis=2)
        aside = gap[..., 0] * sites.away[:, None, 1] - gap[..., 1] * sites.away[:, None, 0]
        facing = (across > 0.5) & (np.abs(aside) < FACING)
        opposite = np.where(facing, across, np.inf).min(axis=1)
    for lanes in (BETWEEN_LANES, 0.0):
        passing = TO_LANE + farther + (lanes + farther if lanes else 0.0)
        wide = sites.beside >= passing + TO_WALL + routes.extra
        wide &= opposite >= passing + TO_LANE + farther
        allowed = near & (wide | quiet)
        some = sites.taking(allowed)
        best = np.zeros((0, 2))
        for upstream in (True, False):
            row = _row(routes, some, entrance, wanted, upstream=upstream)
            if len(row) > len(best):
                best = row
        if len(best):
            return best
    return np.zeros((0, 2))


def _row(
    routes: RouteMap, sites: Sites, entrance: Entrance, wanted: int, *, upstream: bool
) -> Array:
    to_front = entrance.front - sites.points
    far = np.hypot(*to_front.T) if len(to_front) else np.zeros(0)
    on_left = to_front[:, 0] * sites.away[:, 1] - to_front[:, 1] * sites.away[:, 0] > 0.0
    side = on_left if upstream else ~on_left
    heads = np.flatnonzero(side & (far <= FROM_FRONT[1] + 2.0 * routes.extra))
    # Beside the door's wall first, then near.
    beside = np.abs(sites.away[heads] @ entrance.outwards - 1.0)
    order = heads[np.lexsort((heads, np.round(far[heads] + 0.8 * beside, 2)))]
    for head in order[:40].tolist():
        if not routes.is_clear(sites.points[head], entrance.front):
            continue
        row = [head]
        while len(row) < wanted:
            following = _next_in_row(routes, sites, far, row)
            if following < 0:
                break
            row.append(following)
        return sites.points[row]
    return np.zeros((0, 2))


def _next_in_row(routes: RouteMap, sites: Sites, far: Array, row: list[int]) -> int:
    last = row[-1]
    wanted, least = SPOT_STEP + 2.0 * routes.extra, LEAST_STEP + 2.0 * routes.extra
    step = np.hypot(*(sites.points - sites.points[last]).T)
    fits = (step >= least) & (step <= 1.5 * wanted) & (far >= far[last] + 0.5)
    fits &= sites.away @ sites.away[last] > 0.7  # along the same wall
    for other in row[:-1]:
        fits &= np.hypot(*(sites.points - sites.points[other]).T) >= least
    found: IntArray = np.flatnonzero(fits)
    turn = np.zeros(len(found))
    if len(row) > 1:
        before = sites.points[last] - sites.points[row[-2]]
        ahead = sites.points[found] - sites.points[last]
        turn = 1.0 - (ahead @ before) / np.maximum(np.hypot(*ahead.T) * np.hypot(*before), 1e-9)
    price = np.round(np.abs(step[found] - wanted) + 2.0 * turn, 3)
    for other in found[np.lexsort((found, price))].tolist():
        if routes.is_clear(sites.points[last], sites.points[other]):
            return int(other)
    return -1


def choose_parking(
    sites: Sites, lane_gap: Array, taken: Array, wanted: int, *, farther: float = 0.0
) -> Array:
    """Choose places for idle robots, spread over the floor.

    Args:
        sites: places to choose from.
        lane_gap: ``(n,)`` distance of each to the nearest lane [m].
        taken: ``(K, 2)`` places that others need [m].
        wanted: how many.
        farther: more than a pair of robots of the default size keeps apart [m].

    Returns:
        ``(P, 2)`` [m], P <= wanted; none nearer to a lane than 0.75 m.
    """
    apart = np.ones(len(sites.points), dtype=np.bool_)
    if len(taken):
        gaps = np.hypot(*(sites.points[:, None] - taken[None]).transpose(2, 0, 1))
        apart = gaps.min(axis=1) >= PARK_APART + farther
    keep = apart & (lane_gap >= PARK_TO_LANE + farther)
    if not keep.any():
        keep = apart & (lane_gap >= TO_LANE + farther)
    near = keep & (lane_gap <= PARK_WITHIN + farther)
    points = sites.points[near if near.sum() >= wanted * 10 else keep]
    if not len(points):
        return points
    middle = points.mean(axis=0)
    chosen = [points[int(np.argmin(np.round(np.hypot(*(points - middle).T), 3)))]]
    far = np.hypot(*(points - chosen[0]).T)
    while len(chosen) < wanted and far.max() >= PARK_APART + farther:
        chosen.append(points[int(np.argmax(np.round(far, 3)))])
        far = np.minimum(far, np.hypot(*(points - chosen[-1]).T))
    return np.array(chosen)
