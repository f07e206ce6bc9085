"""Objects that cannot stand where a program puts them, out of Scenic's complaint about them."""

from __future__ import annotations

import traceback
from typing import Any

from scenic.core.errors import ScenicError
from scenic.core.object_types import Object
from scenic.core.scenarios import Scenario

from scenic_worlds.checking import names_in_worlds


def misplaced_object(error: BaseException) -> tuple[Any, str] | None:
    """Find the object that Scenic complains about; say what is wrong in the worlds' names.

    Scenic checks fixed objects before it returns the scenario, and calls them "unnamed Bed";
    which objects it was looking at is in its frames.
    """
    if not isinstance(error, ScenicError):
        return None
    text = str(error).strip()
    for frame, _ in traceback.walk_tb(error.__traceback__):
        local = frame.f_locals
        scenario = local.get("self")
        if isinstance(scenario, Scenario) and frame.f_code.co_name == "validate":
            names = names_in_worlds(scenario.objects)
            return local.get("oi"), _validation_reason(text, local, names)
        scenario, thing = local.get("scenario"), local.get("obj")
        if isinstance(scenario, Scenario) and isinstance(thing, Object):
            name = names_in_worlds(scenario.objects).get(thing, "an object")
            if "does not fit" in text:
                return thing, _never_fits(name, local)
            return thing, f"{name}: {text}"
    return None


def _validation_reason(text: str, local: dict[str, Any], names: dict[Any, str]) -> str:
    thing, other = local.get("oi"), local.get("oj")
    if " intersects " in text:
        here, there = _placed(thing, names), _placed(other, names)
        return f"{here} stands where {there} already stands; both are fixed, so no scene is valid"
    if "does not fit" in text:
        container = getattr(thing, "regionContainedIn", None)
        name = _region_name(container) or _region_name(local.get("container"))
        return f"{_placed(thing, names)} is not inside its region ({name})"
    return f"{names.get(thing, 'an object')}: {text}"


def _placed(thing: Any, names: dict[Any, str]) -> str:
    position = thing.position
    return f"{names.get(thing, 'an object')} at ({position.x:g}, {position.y:g})"


def _never_fits(name: str, local: dict[str, Any]) -> str:
    """Say why no position of an object is allowed, from what Scenic's pruning looked at."""
    drawn_from = _region_name(local.get("base"))
    container = _region_name(getattr(local.get("obj"), "regionContainedIn", None))
    where = f"`in {drawn_from}`" if drawn_from else "its position"
    reason = (
        f"{name} fits nowhere: {where} places its centre so that no part of {container} holds it"
    )
    if not drawn_from.startswith("along_wall("):
        return f"{reason}; make it smaller, or place it in a larger region"
    return (
        f"{name} fits nowhere: `in {drawn_from}` puts its centre into the strip beside the wall, "
        f"so it would stand in the wall; write `on {drawn_from}`, which puts its back edge there"
    )


def _region_name(region: Any) -> str:
    if region is None:
        return ""
    return str(getattr(region, "name", None) or type(region).__name__)
