"""ORCA as a stack: robots and people are discs, and each does its half of keeping apart.

`pyrvo` chooses the velocities (van den Berg et al., "Reciprocal n-body collision avoidance", 2011).
The rest is as simple as it gets. The nearest free robot takes a task, the harness plans paths, and
a room has one robot at a time, in the order in which they wanted it.
"""

import math

import numpy as np
import pyrvo
from mrta_stack import serve

AXLE = 0.1  # m from the axle to the point ahead of it that ORCA moves (Snape et al., IROS 2010)
LOOK_AHEAD = 0.6  # m along its path at which a robot aims
ARRIVED = 0.25  # m from its stop at which a robot stays
REPLAN = 4.0  # s; ORCA pushes robots off their paths
STANDS = 2.0  # s of rest after which others plan around a robot
HORIZON, SOLID_HORIZON = 3.0, 1.0  # s ahead that ORCA keeps clear of discs and of solids
MARGIN = 0.05  # m around robots; they need time to speed up, brake and turn
COURTESY = 0.15  # m to keep from people, who may not do their half
ABSENT = (1e4, 1e4)  # m; where people are who are not in the building


class Orca:
    """Asked once a tick; robots come first among the agents of the simulator, then people."""

    def __init__(self, world, harness):
        self.harness, self.robots = harness, world["robots"]
        count = range(len(self.robots))
        self.points = [np.array(room["point"]) for room in world["rooms"]]
        self.areas = {r["room"]: r for r in world["resources"] if r["kind"] == "room"}
        starts = np.array([robot["pose"][:2] for robot in self.robots])
        self.homes = np.array([*world["parking"], *starts[len(world["parking"]) :]])
        self.tasks = []  # that no robot has taken
        self.stops = [[] for _ in count]  # of each robot: claim, task, room, service time
        self.queues = {room: [] for room in range(len(self.points))}  # who has it, who waits
        self.goals, self.paths = [None for _ in count], [None for _ in count]
        self.planned, self.arrived = [-math.inf for _ in count], [None for _ in count]
        self.sim = pyrvo.RVOSimulator(world["dt"], 4.0, 10, HORIZON, SOLID_HORIZON, 0.3, 1.0)
        for solid in world["walls"] + world["furniture"]:
            self.sim.add_obstacle([tuple(point) for point in anticlockwise(solid["polygon"])])
        self.sim.process_obstacles()
        for number, body in enumerate([*self.robots, *world["humans"]]):
            self.sim.add_agent(ABSENT)
            more = AXLE + MARGIN if number < len(self.robots) else COURTESY
            self.sim.set_agent_radius(number, body["radius"] + more)
            self.sim.set_agent_max_speed(number, body.get("max_speed", 2.0))

    def step(self, tick):
        now, pose = tick["time"], tick["pose"]
        self.tasks += tick["tasks"]
        self.assign(pose, now)
        events = [self.serve(robot, pose[robot], now) for robot in range(len(pose))]
        changed = [robot for robot in range(len(pose)) if self.plan(robot, tick)]
        twist = self.velocities(tick)
        twist[[at is not None for at in self.arrived]] = 0.0  # who is served stands
        return {
            "twist": twist,
            "goal": np.array([(np.nan, np.nan) if g is None else g for g in self.goals]),
            "stops_left": [len(stops) for stops in self.stops],
            "paths": [[robot, self.paths[robot]] for robot in changed],
            "events": [event for event in events if event],
        }

    def assign(self, pose, now):
        """Give each task to the nearest robot that has none."""
        for task in list(self.tasks):
            able = [
                (math.dist(pose[i, :2], self.points[task["start"]]), i)
                for i, robot in enumerate(self.robots)
                if not self.stops[i] and robot["joins_at"] <= now
                if task["robot"] in ("", robot["name"])
            ]
            if able:
                robot = min(able)[1]
                self.tasks.remove(task)
                self.stops[robot] = [
                    ("picked-up", task["task"], task["start"], task["pickup_time"]),
                    ("dropped-off", task["task"], task["end"], task["dropoff_time"]),
                ]

    def serve(self, robot, pose, now):
        """Claim a stop once the robot has stood there; queue for rooms, and leave them."""
        claim = None
        if self.arrived[robot] is not None:
            kind, task, _, service = self.stops[robot][0]
            if now - self.arrived[robot] > service + 1.0:  # it came to rest, and stood
                claim = {"kind": kind, "robot": robot, "task": task}
                self.stops[robot].pop(0)
                self.arrived[robot] = None
        path, wanted = self.paths[robot], self.stops[robot][0][2] if self.stops[robot] else None
        if path is not None and not len(path):
            wanted = None  # who has no way keeps no place in a queue
        for room, queue in self.queues.items():
            is_here = room == wanted or self.is_in(room, pose)
            if robot not in queue and is_here:
                queue.append(robot)
            elif robot in queue and not is_here:
                queue.remove(robot)
        has_room = wanted is not None and self.queues[wanted][0] == robot
        near = has_room and math.dist(pose[:2], self.points[wanted]) < ARRIVED
        if near and self.arrived[robot] is None:
            self.arrived[robot] = now
        return claim

    def plan(self, robot, tick):
        """Choose where a robot goes; ask for a new path if that is elsewhere, or it is old."""
        goal, here = self.homes[robot], tick["pose"][robot, :2]
        if self.robots[robot]["joins_at"] > tick["time"]:
            goal = None
        elif self.stops[robot]:
            room = self.stops[robot][0][2]
            queue, spots = self.queues[room], self.areas.get(room, {}).get("spots", [])
            turn = queue.index(robot) if robot in queue else len(queue)
            goal = self.points[room] if not turn or not spots else spots[min(turn, len(spots)) - 1]
        elif math.dist(here, goal) < ARRIVED:
            goal = None
        is_new = (goal is None) != (self.goals[robot] is None)
        is_new = is_new or (goal is not None and math.dist(goal, self.goals[robot]) > 0.0)
        self.goals[robot] = goal
        if goal is None or not (is_new or tick["time"] > self.planned[robot] + REPLAN):
            return False
        stands = [i for i, rest in enumerate(tick["parked_for"]) if rest > STANDS and i != robot]
        path = self.harness.plan(here, goal, avoid=tick["pose"][stands, :2])
        self.paths[robot] = path if len(path) else self.harness.plan(here, goal)
        self.planned[robot] = tick["time"]
        return True

    def velocities(self, tick):
        """Let ORCA move the points ahead of the axles; turn their velocities into twists."""
        pose, (forward, _, turn) = tick["pose"], tick["velocity"].T
        heading = np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1)
        side = np.stack([-heading[:, 1], heading[:, 0]], axis=1)
        places = pose[:, :2] + AXLE * heading
        moves = forward[:, None] * heading + AXLE * turn[:, None] * side
        for robot, (place, move) in enumerate(zip(places, moves, strict=True)):
            self.set(robot, place, move, self.preferred(robot, place))
        humans = zip(tick["human_position"], tick["human_velocity"], strict=True)
        for number, (place, move) in enumerate(humans, start=len(pose)):
            there = np.isfinite(place).all() and np.isfinite(move).all()
            self.set(number, *((place, move, move) if there else (ABSENT, (0, 0), (0, 0))))
        self.sim.do_step()
        chosen = [self.sim.get_agent_velocity(robot) for robot in range(len(pose))]
        velocity = np.array([(v.x, v.y) for v in chosen]).reshape(-1, 2)
        rate = (velocity * side).sum(axis=1) / AXLE
        most = np.array([robot["max_turn_rate"] for robot in self.robots])
        slower = np.minimum(1.0, most / np.maximum(np.abs(rate), 1e-9))
        twist = np.zeros((len(pose), 3))
        twist[:, 0], twist[:, 2] = slower * (velocity * heading).sum(axis=1), slower * rate
        return twist

    def preferred(self, robot, place):
        """Head for a point ahead on the path, slower towards its end."""
        path = self.paths[robot]
        if self.goals[robot] is None or self.arrived[robot] is not None or not len(path):
            return (0.0, 0.0)
        away = np.hypot(*(path - place).T)
        ahead = int(np.argmin(away))
        while ahead < len(path) - 1 and away[ahead] < LOOK_AHEAD:
            ahead += 1
        speed = min(self.robots[robot]["cruise_speed"], away[-1])
        return speed * (path[ahead] - place) / max(away[ahead], 1e-9)

    def set(self, agent, place, move, wish):
        self.sim.set_agent_position(agent, tuple(place))
        self.sim.set_agent_velocity(agent, tuple(move))
        self.sim.set_agent_pref_velocity(agent, tuple(wish))

    def is_in(self, room, pose):
        """Whether a robot is in a room or its doorway."""
        outline = self.areas[room]["release_area"] if room in self.areas else []
        x, y, inside = pose[0], pose[1], False
        for (ax, ay), (bx, by) in zip(outline, outline[1:] + outline[:1], strict=True):
            if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
                inside = not inside
        return inside


def anticlockwise(polygon):
    """Order the corners as RVO2 wants those of solids."""
    corners = np.array(polygon)
    x, y = corners.T
    return corners if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() > 0.0 else corners[::-1]


if __name__ == "__main__":
    serve(Orca, name="ORCA (pyrvo)", version="1.0", says=("deliveries", "goals", "paths"))
