"""Scene -> World: the border; nothing below knows Scenic.

Scenic's heading 0 points to +y, a body's yaw 0 to +x: yaw = heading + pi/2. Scenic's
position is the centre of the box.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from scenic.core.distributions import RejectionException
from scenic.core.scenarios import Scene
from shapely.geometry import Point, Polygon

from mrta_falsify.core import geometry
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.directives import Appear, FollowRoute, StandStill, WaitUntil
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.world import (
    LINKS,
    Blockage,
    CommsOutage,
    Event,
    Furniture,
    HumanSpec,
    RobotSpec,
    Task,
    World,
)
from simulator_interface.scenic_bridge.actions import Reader, pushed_names
from simulator_interface.staging import FOR_EVER

LATE_PEOPLE = 4  # places for people who appear, in a program with a compose block
TASK_FORM = "(arrival, start room, end room, deadline[, pickup s[, dropoff s[, active]]])"


class SceneRejected(RejectionException, WorldError):  # type: ignore[misc] # noqa: N818
    """A sampled scene contradicts itself, for example a deadline before its arrival.

    Those who sample draw another scene; where there is none left to draw, it is an error.
    """


def world_from_scene(scene: Scene, *, name: str, seed: int) -> World:
    """World of a sampled scene of a program over ``scenic_worlds.model``.

    Args:
        scene: what ``Scenario.generate`` returned.
        name: of the world, usually the program's.
        seed: of all noise inside the episode, unless the program gives ``param noise_seed``.

    Returns:
        The world; generated furniture follows the layout's own. Objects and tasks whose
        ``active`` is false are left out.

    Raises:
        SceneRejected: sampled values contradict each other (deadline before arrival, end of
            an event before its start, a standing blockage on a robot's start).
        WorldError: a value that can never be (an unknown room, a task of three entries),
            named as in the program.
    """
    _check_layout_param(scene)
    places = scene.params["_places"]
    layout: World = places.layout
    objects = [item for item in scene.objects if hasattr(item, "kind")]
    names = _names(objects)
    reader = Reader(places, names)
    furniture, robots, humans = list(layout.furniture), [], []
    events: list[Event] = []
    own_behaviors: list[str] = []
    for item in objects:
        if not item.active:
            continue
        name_of_item = names[id(item)]
        try:
            if getattr(item, "behavior", None) is not None:
                person = scripted_person(item, name_of_item, reader)
                humans.append(person)
                if not person.directives:
                    own_behaviors.append(name_of_item)
            elif item.kind == "robot":
                robots.append(_robot(item, name_of_item))
            elif item.kind == "human":
                humans.append(_human(item, name_of_item, places))
            elif item.kind == "blockage":
                events.append(_blockage(item, name_of_item))
            elif item.kind == "comms_outage":
                events.append(_outage(item, name_of_item, names, objects))
            else:
                furniture.append(_furniture(item, name_of_item))
        except InputError as error:
            error.args = (f"{name_of_item}: {error}",)
            raise
        except RejectionException as error:
            raise SceneRejected(f"{name_of_item}: {error}") from None
    pushed = {name for human in humans for name in pushed_names(human.directives)}
    world = dataclasses.replace(
        layout,
        name=name,
        furniture=tuple(
            dataclasses.replace(piece, movable=True) if piece.name in pushed else piece
            for piece in furniture
        ),
        robots=tuple(robots),
        humans=tuple(
            human if human.name not in own_behaviors else _told_by_scenic(human) for human in humans
        ),
        scripted=_scripted(scene, own_behaviors),
        tasks=_tasks(scene.params["tasks"], places),
        events=tuple(events),
        horizon=_number(scene.params["horizon"], "param horizon"),
        ray_noise=_number(scene.params.get("ray_noise", 0.0), "param ray_noise"),
        seed=_seed(scene.params.get("noise_seed"), seed),
    )
    _check_blocked_starts(world)
    late = scene.params.get("late_people", LATE_PEOPLE if is_composed(scene) else 0)
    return _with_late_people(world, int(_number(late, "param late_people")))


def _check_layout_param(scene: Scene) -> None:
    """Refuse a ``param layout`` that came too late for the places.

    Raises:
        WorldError: it stands after the ``model`` line.
    """
    given, used = scene.params.get("layout"), scene.params.get("_layout")
    if given is not used and not (isinstance(given, str) and given == used):
        raise WorldError(
            f"param layout is {_shown(given)} now, but was {_shown(used)} at the line `model "
            "scenic_worlds.model`, where places are made from it; give it before that line"
        )


def _shown(layout: Any) -> str:
    return repr(layout) if isinstance(layout, str) else f"another floor ({type(layout).__name__})"


def object_names(scene: Scene) -> dict[int, str]:
    """Name in the world of each object of a scene, by ``id``."""
    return _names([item for item in scene.objects if hasattr(item, "kind")])


def _names(objects: list[Any]) -> dict[int, str]:
    names: dict[int, str] = {}
    counts: dict[str, int] = {}
    for item in objects:
        given = getattr(item, "name", None)
        counts[item.kind] = counts.get(item.kind, 0) + 1
        names[id(item)] = str(given) if given else f"{item.kind}_{counts[item.kind]}"
    return names


# --- objects ---------------------------------------------------------------------------------


def _number(value: Any, what: str) -> float:
    """``value`` as a finite number.

    Raises:
        WorldError: it is none.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise WorldError(f"{what} is {value!r}; it must be a finite number")
    return number


def _seed(given: Any, otherwise: int) -> int:
    """Seed of the noise that a program fixes, ``otherwise`` if it does not.

    Raises:
        WorldError: it is no whole number >= 0.
    """
    if given is None:
        return otherwise
    number = int(given) if isinstance(given, int) else int(_number(given, "param noise_seed"))
    if number < 0 or number != given:
        raise WorldError(f"param noise_seed is {given!r}; it must be a whole number >= 0")
    return number


def _property(item: Any, name: str) -> float:
    return _number(getattr(item, name), name)


def _pose(item: Any) -> tuple[float, float, float]:
    yaw = float(geometry.wrap_angle(float(item.heading) + np.pi / 2.0))
    return float(item.position.x), float(item.position.y), yaw


def footprint(item: Any) -> Array:
    """Outline ``(4, 2)`` [m] of an object's box, map frame."""
    # Scenic's length runs along the heading, which is the body's x axis.
    outline = geometry.rectangle(float(item.length), float(item.width))
    return frozen_array(geometry.transform(outline, _pose(item)))


def _furniture(item: Any, name: str) -> Furniture:
    return Furniture(
        name=name,
        kind=item.kind,
        polygon=footprint(item),
        height=float(item.height),
        mesh=str(getattr(item, "mesh", "")),
        movable=bool(getattr(item, "movable", False)),
    )


def _robot(item: Any, name: str) -> RobotSpec:
    return RobotSpec(
        name=name,
        model=str(item.model),
        pose=frozen_array(_pose(item)),
        radius=_property(item, "body_radius"),
        max_speed=_property(item, "max_speed"),
        max_acceleration=_property(item, "max_acceleration"),
        max_turn_rate=_property(item, "max_turn_rate"),
        capacity=int(_property(item, "capacity")),
        position_noise=_property(item, "position_noise"),
        heading_noise=_property(item, "heading_noise"),
        wheel_slip=_property(item, "wheel_slip"),
        command_latency=_property(item, "command_latency"),
        joins_at=_property(item, "joins_at"),
    )


def _human(item: Any, name: str, places: Any) -> HumanSpec:
    try:
        route = places.route_points(item.route)
    except InputError as error:
        error.args = (f"route {error}",)
        raise
    if not len(route):
        route = np.array([[float(item.position.x), float(item.position.y)]])
    return HumanSpec(
        name=name,
        route=frozen_array(route),
        repeat=bool(item.repeat),
        speed=_property(item, "speed"),
        radius=_property(item, "body_radius"),
        reacts_to_robots=bool(item.reacts),
        start=_property(item, "phase"),
        appears_at=_property(item, "appears_at"),
        leaves_at=_property(item, "leaves_at"),
    )


def scripted_person(item: Any, name: str, reader: Reader) -> HumanSpec:
    """A person or scripted robot with a behaviour; no directives: it is the program's own."""
    if item.kind not in ("human", "robot"):
        raise WorldError(f"has a behavior; only Human and Robot can have one, it is {item.kind}")
    is_robot = item.kind == "robot"
    return HumanSpec(
        name=name,
        route=frozen_array([[float(item.position.x), float(item.position.y)]]),
        speed=_property(item, "max_speed" if is_robot else "speed"),
        radius=_property(item, "body_radius"),
        reacts_to_robots=True if is_robot else bool(item.reacts),
        appears_at=0.0 if is_robot else _property(item, "appears_at"),
        leaves_at=1e9 if is_robot else _property(item, "leaves_at"),
        directives=reader.of_behavior(item.behavior) or (),
        body="robot" if is_robot else "person",
    )


def late_person(item: Any, name: str, reader: Reader) -> HumanSpec:
    """A person who appears while the simulation runs; directives as far as they are known."""
    if item.behavior is not None:
        return scripted_person(item, name, reader)
    spec = _human(item, name, reader.places)
    if len(spec.route) < 2:
        return dataclasses.replace(spec, directives=(StandStill(),))
    follow = FollowRoute(route=spec.route, repeat=spec.repeat)
    return dataclasses.replace(spec, directives=(follow,))


def _with_late_people(world: World, count: int) -> World:
    """``world`` with places for ``count`` people who may appear while it runs."""
    point = world.rooms[0].point if world.rooms else 0.5 * (world.bounds[:2] + world.bounds[2:])
    taken = {human.name for human in world.humans}
    names = (f"late_{i + 1}" for i in range(count + len(taken)))
    free = [name for name in names if name not in taken][:count]
    never = (WaitUntil(time=FOR_EVER), Appear(point=frozen_array(point)))
    late = (
        HumanSpec(name=name, route=frozen_array(np.atleast_2d(point)), directives=never)
        for name in free
    )
    return dataclasses.replace(world, humans=(*world.humans, *late))


def is_composed(scene: Scene) -> bool:
    """Whether a program has a compose block, so that things may appear while it runs."""
    return getattr(scene.dynamicScenario, "_compose", None) is not None


def _told_by_scenic(human: HumanSpec) -> HumanSpec:
    return dataclasses.replace(human, directives=(StandStill(),))


def _scripted(scene: Scene, own_behaviors: list[str]) -> str:
    """What of the program the world cannot do without, in words."""
    reasons = []
    if own_behaviors:
        reasons.append(f"behaviors of its own ({', '.join(own_behaviors)})")
    if is_composed(scene):
        reasons.append("its compose block")
    return " and ".join(reasons)


# --- events ----------------------------------------------------------------------------------


def _during(item: Any) -> tuple[float, float]:
    try:
        start, end = item.during
    except (TypeError, ValueError):
        raise WorldError(f"during is {item.during!r}; it must be (start, end) in seconds") from None
    first, last = _number(start, "during[0]"), _number(end, "during[1]")
    if last < first:
        raise SceneRejected(f"during ends at {last:g} s, before its start at {first:g} s")
    return first, last


def _blockage(item: Any, name: str) -> Blockage:
    start, end = _during(item)
    return Blockage(
        name=name, polygon=footprint(item), start=start, end=end, height=float(item.height)
    )


def _outage(item: Any, name: str, names: dict[int, str], objects: list[Any]) -> CommsOutage:
    start, end = _during(item)
    given = [item.robots] if isinstance(item.robots, str) else list(item.robots)
    absent = {names[id(o)] for o in objects if o.kind == "robot" and not o.active}
    robots = [names.get(id(robot), str(robot)) for robot in given]
    links = (item.links,) if isinstance(item.links, str) else tuple(item.links)
    for link in links:
        if link not in LINKS:
            raise WorldError(f"links has {link!r}; a link is one of {', '.join(LINKS)}")
    return CommsOutage(
        name=name,
        robots=tuple(robot for robot in robots if robot not in absent),
        links=links,
        start=start,
        end=end,
    )


def _check_blocked_starts(world: World) -> None:
    """Reject scenes in which a blockage of time 0 stands on a robot.

    Scenic itself checks everything else that stands at time 0.
    """
    for event in world.events:
        if not isinstance(event, Blockage) or event.start > 0.0:
            continue
        for robot in world.robots:
            if Polygon(event.polygon).distance(Point(robot.pose[:2])) < robot.radius:
                raise SceneRejected(f"{event.name}: stands on {robot.name} at the start")


# --- tasks -----------------------------------------------------------------------------------


def _tasks(entries: Any, places: Any) -> tuple[Task, ...]:
    if isinstance(entries, str) or not hasattr(entries, "__len__"):
        raise WorldError(f"param tasks is {entries!r}; it must be a list of {TASK_FORM}")
    tasks = (_task(f"param tasks[{i}]", entry, places) for i, entry in enumerate(entries))
    return tuple(task for task in tasks if task is not None)


def _task(where: str, entry: Any, places: Any) -> Task | None:
    """One task; None if it is not active.

    Raises:
        SceneRejected: its deadline comes before its arrival.
        InputError: it is no task.
    """
    if not isinstance(entry, (tuple, list)) or not 4 <= len(entry) <= 7:
        raise WorldError(f"{where} is {entry!r}; it must be {TASK_FORM}")
    if len(entry) == 7 and not entry[6]:
        return None
    arrival, deadline = _number(entry[0], f"{where}: arrival"), _number(entry[3], "deadline")
    services = [_number(value, f"{where}: service time") for value in entry[4:6]]
    pickup, dropoff = [*services, 0.0, 0.0][:2]
    if min(arrival, pickup, dropoff) < 0.0:
        raise WorldError(f"{where} is {entry!r}; times must be >= 0 s")
    if deadline < arrival:
        raise SceneRejected(
            f"{where}: deadline {deadline:g} s is before its arrival at {arrival:g} s"
        )
    try:
        start, end = places.room_number(entry[1]), places.room_number(entry[2])
    except InputError as error:
        error.args = (f"{where}: {error}",)
        raise
    except RejectionException as error:
        raise SceneRejected(f"{where}: {error}") from None
    return Task(
        arrival=arrival,
        start=start,
        end=end,
        deadline=deadline,
        pickup_time=pickup,
        dropoff_time=dropoff,
    )
