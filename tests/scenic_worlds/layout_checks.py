"""What every derived layout owes its robots, measured on the geometry."""

import numpy as np
import shapely
from scipy import ndimage
from shapely.ops import substring

from mrta_falsify.core.costmap import INSCRIBED
from mrta_falsify.core.world import World
from simulator_interface.costmap_layers import build_costmap

ROBOT_RADIUS = 0.22


def unreachable(world: World) -> list[str]:
    """Names of room points, spots, entries and parking that the 0.22 m robot cannot drive to."""
    costmap = build_costmap(world)
    free = costmap.cost < INSCRIBED
    areas, _ = ndimage.label(free)
    places = [(room.name, room.point) for room in world.rooms]
    for resource in world.resources:
        places += [(f"spot of {resource.name}", spot) for spot in resource.spots]
        places += [(f"entry of {resource.name}", point) for point in resource.entry]
    places += [("parking", place) for place in world.parking]
    cells = costmap.cells(np.array([place for _, place in places]))
    labels = areas[cells[:, 0], cells[:, 1]]
    return [name for (name, _), label in zip(places, labels, strict=True)
            if label == 0 or label != labels[0]]  # fmt: skip


def lane_legs(world: World) -> np.ndarray:
    """Every way that robots take, room point first, without the last leg to the tail spot."""
    ways = []
    for lane in world.lanes:
        point = world.rooms[lane.start].point
        ways.append(shapely.linestrings(np.vstack([point, lane.to_room])))
        ways.append(shapely.linestrings(np.vstack([point, lane.to_queue[:-1]])))
    return np.array(ways)


def tail_legs(world: World) -> np.ndarray:
    return np.array([shapely.linestrings(lane.to_queue[-2:]) for lane in world.lanes])


def lane_clearance(world: World) -> float:
    """Smallest distance [m] of a lane to a wall or furniture."""
    solid = shapely.union_all([shapely.Polygon(p) for p in world.solid_polygons()])
    legs = shapely.union_all(np.concatenate([lane_legs(world), tail_legs(world)]))
    return float(shapely.distance(legs, solid))


def spots_of(world: World) -> np.ndarray:
    return np.vstack([resource.spots for resource in world.resources])


def gap_to_lanes(world: World, places: np.ndarray) -> float:
    """Smallest distance [m] of waiting or parking places to what robots drive along."""
    legs = shapely.union_all(lane_legs(world))
    return float(shapely.distance(shapely.points(places), legs).min())


def gap_between(places: np.ndarray) -> float:
    """Smallest distance [m] between two places."""
    gaps = np.hypot(*(places[:, None, :] - places[None, :, :]).transpose(2, 0, 1))
    return float(gaps[~np.eye(len(places), dtype=bool)].min())


def crowding(world: World) -> float:
    """Smallest distance [m] of a waiting spot to traffic, turning in to the own tail left out."""
    ways = {}
    for end in range(len(world.rooms)):
        ways[end] = [
            shapely.linestrings(np.vstack([world.rooms[lane.start].point, lane.to_room]))
            for lane in world.lanes
        ]
        for lane in world.lanes:
            way = shapely.linestrings(lane.to_queue)
            length = float(shapely.length(way))
            if lane.end != end:
                ways[end].append(way)
            elif length > 2.0:
                ways[end].append(substring(way, 0.0, length - 1.5))
    gaps = [
        shapely.distance(shapely.points(resource.spots), shapely.union_all(ways[i])).min()
        for i, resource in enumerate(world.resources)
        if len(resource.spots)
    ]
    return float(min(gaps, default=np.inf))
