"""What is told twice is told alike: verdicts, counters, books, margins, pages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from frames import DT, Human, Robot, Script, room_resource
from shapely.geometry import Point, Polygon

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.trace import TraceRecorder, read_trace, write_trace
from mrta_falsify.core.world import HumanSpec, RobotSpec, Task, Wall
from mrta_falsify.specs.books import Books, confirmed
from mrta_falsify.specs.contacts import CONTACT_PAUSE, DRIVING_SPEED, GAP_CAP, ContactCounter
from mrta_falsify.specs.objectives import objectives
from mrta_falsify.trial import Job, on_kinematic_engine, run_job
from reports.run_report import task_table

FEW_AND_MANY = [
    pytest.param(range(12, 18), id="few"),
    pytest.param(range(18, 318), id="many", marks=pytest.mark.long),
]
ROOMS = ((-1.5, 0.0), (1.5, 0.0))
ARENA = np.array([2.5, 1.2])  # m, half sides
#: robustness never rises, and the first violation is told at the tick in which it is seen
FOLDED = {
    "no_robot_robot_contact": {},
    "no_robot_human_contact": {},
    "human_clearance": {},
    "exclusive_use": {},
    "kinematic_limits": {},
    "honest_events": {},
    "no_starvation": {"robot_patience": 4.0, "task_patience": 6.0},
    "progress": {"window": 3.0},
}


def spec(name: str, **options):
    return registry.build("specification", Choice(name, options))


def walk(random: np.random.Generator, fastest: float, places=()):
    """A track over random points with pauses, and when it pauses at which of ``places``."""
    times, points, halts = [0.0], [random.uniform(-ARENA, ARENA)], []
    while times[-1] < 30.0:
        number = int(random.integers(len(places))) if len(places) and random.random() < 0.8 else -1
        end = np.array(places[number]) if number >= 0 else random.uniform(-ARENA, ARENA)
        way = float(np.hypot(*(end - points[-1])))
        speed = random.choice([0.06, 0.3 * fastest, fastest], p=[0.1, 0.3, 0.6])
        times.append(times[-1] + max(0.1, way / speed))
        points.append(end)
        times.append(times[-1] + random.uniform(0.1, 3.0))
        points.append(end)
        halts.append((number, times[-2], times[-1]))
    rows = np.array(points)

    def at(time: float) -> tuple[float, float]:
        return tuple(float(np.interp(time, times, rows[:, axis])) for axis in range(2))

    return at, halts


def drawn_script(seed: int) -> Script:
    """Robots and people who run into each other, and a stack that claims this and that."""
    random = np.random.default_rng(seed)
    seconds = float(random.uniform(8.0, 20.0))
    robots, events = [], []
    tasks = [
        Task(
            arrival=(arrival := float(seconds * random.choice([0.0, 0.1, 0.5, 1.2]))),
            start=(start := int(random.integers(2))),
            end=1 - start,
            deadline=arrival + float(random.uniform(2.0, 15.0)),
            pickup_time=0.5,
            dropoff_time=0.5,
        )
        for _ in range(random.integers(6))
    ]
    for i in range(random.integers(1, 5)):
        at, halts = walk(random, 1.3, ROOMS)
        wants = random.random() < 0.8
        goal = (lambda time, at=at: at(time + 2.0)) if random.random() < 0.5 else ROOMS[i % 2]
        robots.append(
            Robot(lambda time, at=at: (*at(time), 0.0), goal=goal if wants else (np.nan, np.nan))
        )
        for room, begin, end in halts:
            for number, task in enumerate(tasks):
                kind = {task.start: "picked-up", task.end: "dropped-off"}.get(room)
                if kind and random.random() < 0.7:
                    tick = int(random.uniform(begin, end) / DT)
                    late = float(random.choice([0.0, 0.0, -0.6, 0.6, 2.0]))
                    events.append(
                        (tick, StackEvent(time=tick * DT + late, kind=kind, robot=i, task=number))
                    )
    people = [Human(walk(random, 1.2)[0]) for _ in range(random.integers(5))]
    orders = random.uniform(-0.2, 0.8, size=(40, len(robots), 1)) * [1.0, 0.0, 0.0]
    orders[random.random(orders.shape[:2]) < 0.5] = 0.0
    return Script(
        robots=robots,
        humans=people,
        seconds=seconds,
        rooms=ROOMS,
        tasks=tasks,
        resources=[room_resource(0, ROOMS[0], [], reach=float(random.uniform(0.8, 1.5)))],
        horizon=seconds if random.random() < 0.7 else 60.0,
        stack_events=lambda tick: tuple(event for when, event in events if when == tick),
        command=lambda time: orders[int(time) % len(orders)],
    )


def moving_robots(frames) -> list[np.ndarray]:
    """Which robots count as moving, tick by tick, as the documentation defines it."""
    found, count = [], len(frames[0].sensed.pose)
    touched, state = np.full(count, -np.inf), np.zeros(count, dtype=bool)
    for k, frame in enumerate(frames):
        before, sensed = frames[max(k - 1, 0)], frame.sensed
        fast, was = (np.hypot(*f.sensed.velocity[:, :2].T) > DRIVING_SPEED for f in (frame, before))
        ordered = np.hypot(*before.command.twist[:, :2].T) > DRIVING_SPEED
        for i in range(count):
            goes_on = sensed.time - touched[i] <= CONTACT_PAUSE
            if goes_on or sensed.contact[i, 1]:
                state[i] = (state[i] if goes_on else was[i]) or (fast[i] and ordered[i])
            else:
                state[i] = fast[i] or was[i]
            if sensed.contact[i, 1]:
                touched[i] = sensed.time
        found.append(state.copy())
    return found


def narrowest_to_people(frames, moving, limit: float) -> float:
    least = GAP_CAP
    for frame, who in zip(frames, moving, strict=True):
        gap, touched = frame.sensed.gap_human, frame.sensed.contact[:, 1]
        gap = np.where(touched, np.minimum(gap, -1e-3), np.maximum(gap, 0.0))
        least = min(least, np.where(who, gap, np.inf).min(initial=np.inf) - limit)
    return least


def is_overfull(world, frames) -> bool:
    """Whether more robots were inside the resource than it has room for, after it had been free."""
    (resource,) = world.resources
    area = Polygon(resource.release_area).buffer(-0.5, join_style="mitre")
    if area.is_empty:
        area = Polygon(resource.release_area)
    was_free = False
    for frame in frames:
        inside = sum(area.contains(Point(pose[:2])) for pose in frame.sensed.pose)
        if inside > resource.capacity and was_free:
            return True
        was_free = was_free or inside <= resource.capacity
    return False


def seconds_held(frames, robot: int, since: float, until: float) -> dict[str, float]:
    """How long edges held a robot, by kind and in all, counted tick by tick."""
    spent: dict[str, float] = {}
    for frame in frames:
        if not since - 1e-9 <= frame.sensed.time < until - 1e-9:
            continue
        kinds = set()
        for edge in frame.blocked_by:
            if edge.robot == robot and edge.other >= 0:
                kinds |= {"any", "person" if edge.cause == "human" else "robot"}
            elif edge.robot == robot and edge.cause in ("wall", "no-path"):
                kinds |= {"any", "solid"}
        for kind in kinds:
            spent[kind] = spent.get(kind, 0.0) + DT
    return spent


def check_verdict(verdict, now: float) -> None:
    """A verdict agrees with itself, and with the margin that a search sees."""
    margin = objectives([verdict])
    assert verdict.violated == (verdict.robustness < 0.0)
    assert verdict.violated == (margin.get(verdict.spec, 1.0) < 0.0)
    assert verdict.violated == (verdict.violated_at is not None)
    if verdict.violated:
        assert verdict.who
        assert verdict.violated_at <= now


def check_held(frames, verdict) -> None:
    evidence = verdict.evidence
    if "held" not in evidence:
        return
    names = [f"robot{i + 1}" for i in range(len(frames[0].sensed.pose))]
    robot = names.index(evidence["robot"])
    spent = seconds_held(frames, robot, evidence["since"], evidence["time"])
    assert evidence["held_s"] == pytest.approx(spent.pop("any", 0.0), abs=1e-6)
    assert evidence["held"] == pytest.approx(spent, abs=1e-6)


@pytest.mark.parametrize("seeds", FEW_AND_MANY)
def test_verdicts_of_scripted_runs_agree_with_counters_and_books(seeds, tmp_path):
    violated: dict[str, int] = {}
    for seed in seeds:
        script = drawn_script(seed)
        world = script.world()
        frames = list(script.frames(world))
        specs = {name: spec(name, **options) for name, options in FOLDED.items()}
        specs["at_rest_too"] = spec("no_robot_human_contact", count_at_rest=True)
        specs |= {name: spec(name) for name in ("deadlines", "all_tasks_done")}
        counter, books = ContactCounter(), Books(world)
        recorder = TraceRecorder(
            world_digest=world.digest(),
            dt=DT,
            robots=tuple(robot.name for robot in world.robots),
            humans=tuple(human.name for human in world.humans),
        )
        for judging in (counter, *specs.values()):
            judging.start(world, DT)
        last = {name: one.verdict() for name, one in specs.items()}
        for frame in frames:
            now = frame.sensed.time
            counter.update(frame)
            books.update(frame.sensed, frame.events)
            recorder.add(frame)
            for name, one in specs.items():
                one.update(frame)
                verdict = one.verdict()
                check_verdict(verdict, now)
                if name in FOLDED and verdict.violated and not last[name].violated:
                    assert verdict.violated_at == now, (seed, name)
                if name in FOLDED:
                    assert verdict.robustness <= last[name].robustness, (seed, name)
                last[name] = verdict

        totals = counter.totals()
        touch, clearance = last["no_robot_human_contact"], last["human_clearance"]
        assert touch.violated == (totals["robot_human"] > 0), seed
        assert last["no_robot_robot_contact"].violated == (totals["robot_robot"] > 0), seed
        any_touch = totals["robot_human"] + totals["robot_human_at_rest"] > 0
        assert last["at_rest_too"].violated == any_touch, seed
        for verdict in (touch, clearance, last["at_rest_too"]) if world.humans else ():
            assert verdict.evidence["contacts"] == totals["robot_human"], seed
            at_rest = verdict.evidence["at_rest"]
            assert at_rest["contacts"] == totals["robot_human_at_rest"], seed
            assert (at_rest["narrowest"] < 0.0) == (at_rest["contacts"] > 0), seed
        moving = moving_robots(frames)
        assert touch.robustness == narrowest_to_people(frames, moving, 0.0), seed
        assert clearance.robustness == narrowest_to_people(frames, moving, 0.1), seed

        assert last["exclusive_use"].violated == is_overfull(world, frames), seed
        check_held(frames, last["progress"])

        done, timely = last["all_tasks_done"], last["deadlines"]
        assert done.evidence["open"] == list(books.open), seed
        assert done.evidence["delivered"] == len(books.due & books.delivered.keys()), seed
        assert len(done.evidence["claims_refused"]) == len(books.refused.rows), seed
        late = [i for i, left in books.margins(frames[-1].sensed.time).items() if left < 0.0]
        assert [row["task"] for row in timely.evidence["late"]] == late, seed
        assert last["honest_events"].violated or not books.refused.rows, seed

        path = tmp_path / "trace.zip"
        write_trace(recorder.finish("horizon"), path)
        stops = confirmed(read_trace(path), world).events
        delivered = {e.task: e.time for e in stops if e.kind == "dropped-off"}
        assert delivered == books.delivered, seed
        assert {e.task: e.time for e in stops if e.kind == "picked-up"} == books.picked, seed

        for name, verdict in last.items():
            violated[name] = violated.get(name, 0) + verdict.violated
        violated["delivered"] = violated.get("delivered", 0) + bool(books.delivered)
    # the draws show all that they are to show; scripts know no limits of acceleration
    assert all(violated.values()), violated
    assert max(n for name, n in violated.items() if name != "kinematic_limits") < len(seeds)


def drawn_world(hall, seed: int):
    """The hall with robots, people, walls and tasks of a draw."""
    random = np.random.default_rng(seed)
    starts = [(1.5, 2.0), (10.5, 6.0), (1.5, 6.0), (10.5, 2.0)][: random.integers(2, 5)]
    robots = tuple(
        RobotSpec(name=f"robot{i + 1}", pose=np.array([*start, random.uniform(-3.0, 3.0)]))
        for i, start in enumerate(starts)
    )
    humans = tuple(
        HumanSpec(
            name=f"human{i}",
            route=random.uniform((0.8, 0.8), (11.2, 7.2), size=(3, 2)),
            reacts_to_robots=bool(random.random() < 0.3),
        )
        for i in range(random.integers(4))
    )
    tasks = tuple(
        Task(
            arrival=(arrival := float(random.uniform(0.0, 50.0))),
            start=(start := int(random.integers(2))),
            end=1 - start,
            deadline=arrival + float(random.uniform(20.0, 50.0)),
        )
        for _ in range(random.integers(1, 6))
    )
    walls = hall.walls
    if random.random() < 0.5:  # the hall in two halves, and a way that may be too narrow
        gap = float(random.uniform(0.5, 2.5))
        walls += (Wall(name="middle", polygon=rectangle(0.2, 8.0 - gap, (8.0, 4.0 - gap / 2))),)
    return dataclasses.replace(
        hall,
        walls=walls,
        robots=robots,
        humans=humans,
        tasks=tasks,
        horizon=float(random.uniform(25.0, 45.0)),
        seed=seed,
    )


RUNS = [
    pytest.param(range(2), id="few"),
    pytest.param(range(2, 102), id="many", marks=pytest.mark.long),
]


@pytest.mark.parametrize("seeds", RUNS)
def test_outcomes_of_runs_agree_with_verdicts_and_pages(seeds, hall):
    names = (
        *("no_robot_robot_contact", "no_robot_static_contact", "no_robot_human_contact"),
        *("human_clearance", "deadlines", "all_tasks_done", "kinematic_limits"),
        *("progress{window: 8}", "exclusive_use", "no_starvation{robot_patience: 10}"),
    )
    for seed in seeds:
        world = drawn_world(hall, seed)
        job = Job(world=world, config=on_kinematic_engine(StackConfig()), specifications=names)
        outcome = run_job(job)
        verdicts = {verdict.spec: verdict for verdict in outcome.verdicts}
        for verdict in verdicts.values():
            check_verdict(verdict, outcome.sim_time)
        for kind in ("robot", "human", "static"):
            counted = outcome.contacts[f"robot_{kind}"]
            assert verdicts[f"no_robot_{kind}_contact"].violated == (counted > 0), seed
        touch = verdicts["no_robot_human_contact"]
        if world.humans:
            assert touch.evidence["contacts"] == outcome.contacts["robot_human"], seed
            at_rest = touch.evidence["at_rest"]["contacts"]
            assert at_rest == outcome.contacts["robot_human_at_rest"], seed

        done, timely, tasks = verdicts["all_tasks_done"], verdicts["deadlines"], outcome.tasks
        assert done.violated == (outcome.ended == "horizon" and tasks.completed < tasks.total)
        assert (tasks.completed, tasks.total) == (
            done.evidence["delivered"],
            done.evidence["total"],
        )
        late = {row["task"] for row in timely.evidence["late"]}
        assert tasks.late == len(late | set(done.evidence["open"])), seed
        states = [row[-1] for row in task_table(world, outcome.trace).rows]
        assert states.count("not delivered") == len(world.tasks) - tasks.completed, seed
        told_late = {number for number, state in enumerate(states) if state == "late"}
        assert told_late == late - set(done.evidence["open"]), seed

        held = verdicts["progress"].evidence
        if "held" in held:
            trace = outcome.trace
            low, high = (round(held[key] / trace.dt) for key in ("since", "time"))
            ticks = {kind: set() for kind in ("person", "robot", "solid")}
            for span in trace.edges:
                if span.edge.robot != trace.robots.index(held["robot"]):
                    continue
                kind = "person" if span.edge.cause == "human" else "robot"
                if span.edge.other < 0:
                    kind = "solid" if span.edge.cause in ("wall", "no-path") else ""
                if kind:
                    ticks[kind] |= set(range(max(span.first, low), min(span.last + 1, high)))
            spent = {kind: len(found) * trace.dt for kind, found in ticks.items() if found}
            assert held["held"] == pytest.approx(spent, abs=1e-6), seed
            whole = len(set().union(*ticks.values())) * trace.dt
            assert held["held_s"] == pytest.approx(whole, abs=1e-6), seed
