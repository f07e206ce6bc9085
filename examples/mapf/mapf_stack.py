"""A multi-agent path finder as a stack: HCA* plans all robots' ways, the harness drives them.

`w9_pathfinding` plans on a lattice of places, one place a step and one robot a place (Silver,
"Cooperative pathfinding", 2005). Robots do not keep to its clock. A robot may enter a place once
those that the plan lets pass before have left it (Hoenig et al., ICAPS 2016).
"""

import math

import numpy as np
from mrta_stack import serve
from w9_pathfinding.envs import Graph
from w9_pathfinding.mapf import HCAStar

PITCH = 0.7  # m between places: robots of 0.44 m stand on two of them side by side
NEAR = 0.35  # m from a place at which a robot is there
LEAD = 4  # steps ahead that a robot is sent: less than a room is deep
CLOSE = 150  # cost from which a place is too near to something; 253: the robot touches it
LONGEST = 400  # steps of a plan


class Mapf:
    """Asked once a tick."""

    def __init__(self, world, harness):
        self.robots, self.count = world["robots"], len(world["robots"])
        self.areas = {r["room"]: r["release_area"] for r in world["resources"] if "room" in r}
        rooms = [room["point"] for room in world["rooms"]]
        starts = [robot["pose"][:2] for robot in self.robots]
        homes = [*world["parking"], *starts[len(world["parking"]) :]]
        self.places, edges = lattice(harness.map(), [*rooms, *homes])
        graph = Graph(len(self.places), edges=edges, edge_collision=True)
        graph.set_coordinates(self.places.tolist())
        self.finder = HCAStar(graph)
        self.rooms = [self.nearest(point) for point in rooms]
        taken = set(self.rooms)
        self.homes = [self.claim(point, taken) for point in homes[: self.count]]
        taken = set()
        self.ways = [[self.claim(point, taken)] for point in starts]  # of places, step by step
        self.reached, self.sent = [0] * self.count, [0] * self.count  # steps of them
        self.tasks, self.holder, self.aims = [], {}, None
        self.stops = [[] for _ in self.robots]  # of each robot: claim, task, room, service time

    def nearest(self, point, taken=()):
        away = np.hypot(*(self.places - point).T)
        away[list(taken)] = np.inf
        return int(np.argmin(away))

    def claim(self, point, taken):
        place = self.nearest(point, taken)
        taken.add(place)
        return place

    def step(self, tick):
        self.tasks += tick["tasks"]
        self.assign(tick)
        events = [self.serve(robot, tick) for robot in range(self.count)]
        aims = [self.aim(robot, tick) for robot in range(self.count)]
        self.progress(tick["pose"])
        if aims != self.aims and self.reached == self.sent:  # all stand where they were sent
            self.plan(aims)
        changed = [r for r in range(self.count) if self.send(r, is_old=aims != self.aims)]
        places = self.places
        return {
            "follow": list(range(self.count)),
            "goal": np.array([places[aim] for aim in aims]),
            "stops_left": [len(stops) for stops in self.stops],
            "paths": [[r, self.path(r, tick["pose"][r, :2])] for r in changed],
            "events": [event for event in events if event],
        }

    def assign(self, tick):
        """Give each task to the nearest robot that has none."""
        for task in list(self.tasks):
            able = [
                (math.dist(tick["pose"][i, :2], self.places[self.rooms[task["start"]]]), i)
                for i, robot in enumerate(self.robots)
                if not self.stops[i] and robot["joins_at"] <= tick["time"]
                if task["robot"] in ("", robot["name"])
            ]
            if able:
                self.tasks.remove(task)
                self.stops[min(able)[1]] = [
                    ("picked-up", task["task"], task["start"], task["pickup_time"]),
                    ("dropped-off", task["task"], task["end"], task["dropoff_time"]),
                ]

    def serve(self, robot, tick):
        """Claim a stop once the robot has stood there for long enough."""
        if not self.stops[robot]:
            return None
        kind, task, room, service = self.stops[robot][0]
        away = math.dist(tick["pose"][robot, :2], self.places[self.rooms[room]])
        if away > NEAR or tick["parked_for"][robot] < service + 0.5:
            return None
        self.stops[robot].pop(0)
        return {"kind": kind, "robot": robot, "task": task}

    def aim(self, robot, tick):
        """Choose where a robot goes: a room has one at a time, who has to wait goes home."""
        wanted = self.stops[robot][0][2] if self.stops[robot] else None
        for room, holder in list(self.holder.items()):
            inside = is_in(self.areas.get(room, []), tick["pose"][holder])
            if holder == robot and room != wanted and not inside:
                del self.holder[room]
        if wanted is None or self.holder.setdefault(wanted, robot) != robot:
            return self.homes[robot]
        return self.rooms[wanted]

    def plan(self, aims):
        """Plan for all; who is planned for first may stand in a later one's way, so try others."""
        starts = [way[step] for way, step in zip(self.ways, self.sent, strict=True)]
        for first in range(self.count):
            order = [*range(first, self.count), *range(first)]
            found = self.finder.mapf(
                [starts[r] for r in order], [aims[r] for r in order], max_length=LONGEST
            )
            if found:
                self.ways = [found[order.index(robot)] for robot in range(self.count)]
                self.reached, self.sent = [0] * self.count, [0] * self.count
                self.aims = aims
                return

    def progress(self, pose):
        for robot, way in enumerate(self.ways):
            for step in range(self.sent[robot], self.reached[robot], -1):
                if math.dist(pose[robot, :2], self.places[way[step]]) < NEAR:
                    self.reached[robot] = step
                    break

    def send(self, robot, *, is_old):
        """Send a robot on, as far as the others' ways let it; an old plan goes no further."""
        way, before = self.ways[robot], self.sent[robot]
        while not is_old and self.sent[robot] < min(len(way) - 1, self.reached[robot] + LEAD):
            step = self.sent[robot] + 1
            if any(self.comes_first(other, robot, step) for other in range(self.count)):
                break
            self.sent[robot] = step
        return self.sent[robot] != before

    def comes_first(self, other, robot, step):
        """Whether another robot has to pass the place of a step and has not left it."""
        earlier = self.ways[other][:step]
        place = self.ways[robot][step]
        if other == robot or place not in earlier:
            return False
        return self.reached[other] <= max(k for k, p in enumerate(earlier) if p == place)

    def path(self, robot, here):
        steps = self.ways[robot][self.reached[robot] : self.sent[robot] + 1]
        return np.vstack([here, *(self.places[place] for place in steps[1:])])


def lattice(costmap, ends):
    """Give free places `(P, 2)` and the free ways between neighbours, to reach most of `ends`."""
    cost, size, origin = costmap["cost"], costmap["resolution"], np.array(costmap["origin"][:2])
    extent = np.array(cost.shape[::-1]) * size

    def is_free(points):
        col, row = ((np.asarray(points) - origin) / size).astype(int).T
        return cost[row.clip(0, len(cost) - 1), col.clip(0, cost.shape[1] - 1)] < CLOSE

    best = None
    for shift in np.ndindex(4, 4):  # a lattice may just miss a doorway
        first = origin + PITCH * (np.array(shift) + 0.5) / 4
        cells = np.array(list(np.ndindex(*((origin + extent - first) / PITCH).astype(int))))
        cells = cells[is_free(first + PITCH * cells)]
        number = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
        places, edges = first + PITCH * cells, []
        for (x, y), k in number.items():
            for other in ((x + 1, y), (x, y + 1)):
                m = number.get(other)
                if m is not None and is_free(np.linspace(places[k], places[m], 15)).all():
                    edges += [(k, m), (m, k)]
        main = max(Graph(len(places), edges=edges).find_scc(), key=len)
        away = [np.hypot(*(places[main] - end).T).min() for end in ends]
        if best is None or max(away) < best[0]:
            new = {k: i for i, k in enumerate(main)}
            best = max(away), places[main], [(new[a], new[b]) for a, b in edges if a in new]
    return best[1], best[2]


def is_in(outline, pose):
    """Whether a robot is in a room or its doorway."""
    x, y, inside = pose[0], pose[1], False
    for (ax, ay), (bx, by) in zip(outline, outline[1:] + outline[:1], strict=True):
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
    return inside


if __name__ == "__main__":
    serve(Mapf, name="HCA* (w9-pathfinding)", version="1.0", says=("deliveries", "goals", "paths"))
