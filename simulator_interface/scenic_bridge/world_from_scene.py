"""Scene -> World: the border; nothing below knows Scenic."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from scenic.core.scenarios import Scene

from mrta_falsify.core.directives import StandStill
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import (
    Blockage,
    Event,
    Furniture,
    HumanSpec,
    Resource,
    RobotSpec,
    Task,
    World,
)
from simulator_interface.scenic_bridge.behaviors import BehaviorReader
from simulator_interface.scenic_bridge.scene_contract import MODEL, places_of_scene
from simulator_interface.scenic_bridge.scene_objects import (
    names_in_world,
    read_blockage,
    read_furniture,
    read_outage,
    read_robot,
    world_objects,
)
from simulator_interface.scenic_bridge.scene_people import (
    pushed_names,
    read_human,
    scripted_person,
    with_late_people,
)
from simulator_interface.scenic_bridge.scene_resources import (
    check_waiting_spots,
    is_resource,
    read_resource,
    use_room,
)
from simulator_interface.scenic_bridge.scene_tasks import read_tasks
from simulator_interface.scenic_bridge.scene_values import (
    SceneRejected,
    naming,
    read_number,
    read_seed,
)
from simulator_interface.solids import Solids

LATE_PEOPLE = 4  # places for people who appear, in a program with a compose block


@dataclass(slots=True)
class _Contents:
    """What the objects of a scene put into a world."""

    furniture: list[Furniture]
    resources: list[Resource]
    robots: list[RobotSpec] = field(default_factory=list)
    humans: list[HumanSpec] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    own_behaviors: list[str] = field(default_factory=list)  #: people with the program's own


def world_from_scene(scene: Scene, *, name: str, seed: int) -> World:
    """Make the world of a sampled scene of a program over ``scenic_worlds.model``.

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
        WorldError: a value is never allowed (an unknown room, a task of three entries);
            it is named as in the program.
    """
    _check_layout_param(scene)
    params, places = scene.params, places_of_scene(scene)
    contents = _read_objects(scene)
    world = dataclasses.replace(
        places.layout,
        name=name,
        furniture=_movable_where_pushed(contents),
        resources=tuple(contents.resources),
        robots=tuple(contents.robots),
        humans=tuple(contents.humans),
        scripted=_scripted(scene, contents.own_behaviors),
        tasks=_tasks(scene),
        events=tuple(contents.events),
        horizon=read_number(params["horizon"], "param horizon"),
        ray_noise=read_number(params.get("ray_noise", 0.0), "param ray_noise"),
        seed=read_seed(params.get("noise_seed"), seed),
        stack_params=_stack_params(params.get("stack_params", ())),
    )
    _check_blocked_starts(world)
    check_waiting_spots(world, places.layout)
    late = params.get("late_people", LATE_PEOPLE if is_composed(scene) else 0)
    return with_late_people(world, int(read_number(late, "param late_people")))


def _tasks(scene: Scene) -> tuple[Task, ...]:
    objects = world_objects(scene)
    names = names_in_world(objects)
    absent = {names[id(item)] for item in objects if item.kind == "robot" and not item.active}
    return read_tasks(scene.params["tasks"], places_of_scene(scene), names, absent)


def _stack_params(given: Any) -> dict[str, float]:
    """Read pairs of names and numbers; a list, since Scenic does not sample what is in a dict."""
    what = "param stack_params"
    is_list = isinstance(given, (list, tuple))
    if not is_list or not all(isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in given):
        raise WorldError(f"{what} is {given!r}; it must be a list of pairs (name, number)")
    if not all(isinstance(name, str) for name, _ in given):
        raise WorldError(f"{what} is {given!r}; each name must be a text")
    return {name: read_number(value, f"{what}: {name}") for name, value in given}


def is_composed(scene: Scene) -> bool:
    """Whether a program has a compose block, so that things may appear while it runs."""
    return getattr(scene.dynamicScenario, "_compose", None) is not None


def _check_layout_param(scene: Scene) -> None:
    """Refuse a ``param layout`` that came too late for the places.

    Raises:
        WorldError: it stands after the ``model`` line.
    """
    given, used = scene.params.get("layout"), scene.params.get("_layout")
    if given is not used and not (isinstance(given, str) and given == used):
        raise WorldError(
            f"param layout is {_shown(given)} now, but was {_shown(used)} at the line `model "
            f"{MODEL}`, where places are made from it; give it before that line"
        )


def _shown(layout: Any) -> str:
    return repr(layout) if isinstance(layout, str) else f"another floor ({type(layout).__name__})"


def _read_objects(scene: Scene) -> _Contents:
    places, objects = places_of_scene(scene), world_objects(scene)
    names = names_in_world(objects)
    reader = BehaviorReader(places, names)
    contents = _Contents(list(places.layout.furniture), list(places.layout.resources))
    for item in objects:
        if not item.active:
            continue
        name = names[id(item)]
        with naming(name):
            if getattr(item, "behavior", None) is not None:
                _add_scripted_person(contents, scripted_person(item, name, reader))
            elif item.kind == "robot":
                contents.robots.append(read_robot(item, name))
            elif item.kind == "human":
                contents.humans.append(read_human(item, name, places))
            elif item.kind == "blockage":
                contents.events.append(read_blockage(item, name))
            elif item.kind == "comms_outage":
                contents.events.append(read_outage(item, name, names, objects))
            elif item.kind == "room_use":
                contents.resources = use_room(contents.resources, item, name, places)
            elif is_resource(item):
                contents.resources.append(read_resource(item, name, places))
            else:
                contents.furniture.append(read_furniture(item, name))
    return contents


def _add_scripted_person(contents: _Contents, person: HumanSpec) -> None:
    if not person.directives:  # Scenic directs it, tick by tick
        contents.own_behaviors.append(person.name)
        person = dataclasses.replace(person, directives=(StandStill(),))
    contents.humans.append(person)


def _movable_where_pushed(contents: _Contents) -> tuple[Furniture, ...]:
    """The furniture; what a script pushes is movable."""
    pushed = {name for human in contents.humans for name in pushed_names(human.directives)}
    return tuple(
        dataclasses.replace(piece, movable=True) if piece.name in pushed else piece
        for piece in contents.furniture
    )


def _scripted(scene: Scene, own_behaviors: list[str]) -> str:
    """Say in words which parts of the program the world needs."""
    reasons = []
    if own_behaviors:
        reasons.append(f"behaviors of its own ({', '.join(own_behaviors)})")
    if is_composed(scene):
        reasons.append("its compose block")
    return " and ".join(reasons)


def _check_blocked_starts(world: World) -> None:
    """Reject scenes in which a blockage of time 0 stands on a robot.

    Scenic itself checks everything else that stands at time 0.
    """
    for event in world.events:
        if not isinstance(event, Blockage) or event.start > 0.0:
            continue
        blockage = Solids([event.polygon])
        for robot in world.robots:
            if blockage.met_by_disc(float(robot.pose[0]), float(robot.pose[1]), robot.radius):
                raise SceneRejected(f"{event.name}: stands on {robot.name} at the start")


__all__ = ["SceneRejected", "is_composed", "world_from_scene"]
