"""Robot models: a URDF and a few numbers (``robots/models.yaml``, or a file of the user's)."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import shapely

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError, UnknownNameError
from mrta_falsify.core.free_space import Disc
from simulator_interface.engines.footprints import convex_outline, read_footprint

DISC_ERROR = 0.001  # m of the largest disc inside a body
ROBOTS = Path(__file__).parent.parent / "robots"
JOINT_COUNT = {"differential": 2, "holonomic": 3}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotModel:
    """A kind of robot.

    ``differential``: ``joints`` are the left and the right wheel; the URDF's root frame lies
    on the floor between the wheels, x forward. ``holonomic``: ``joints`` are the sliders along
    the map's x and y and the turntable that carry the base, whose frame they end in.
    """

    urdf: str  #: file, relative to the model file
    base: Literal["differential", "holonomic"] = "differential"
    joints: tuple[str, ...]  #: joint names in the order that ``base`` asks for
    wheel_separation: float = quantity(above=0.0, unit="m", default=0.287)
    wheel_radius: float = quantity(above=0.0, unit="m", default=0.033)
    wheels_touch: Literal["floor", "everything"] = "everything"  #: what wheels collide with
    max_torque: float = quantity(above=0.0, unit="N m", default=2.0)  #: of each wheel motor
    max_force: float = quantity(above=0.0, unit="N", default=100.0)  #: of each slider
    max_speed: float = quantity(above=0.0, unit="m/s", default=1.5)
    max_acceleration: float = quantity(above=0.0, unit="m/s^2", default=1.0)
    max_turn_rate: float = quantity(above=0.0, unit="rad/s", default=2.0)
    max_turn_acceleration: float = quantity(
        above=0.0, unit="rad/s^2", default=7.0
    )  #: 1 m/s^2 at both wheels of a Waffle, as MRTA-Sim's wheel limit of 30 rad/s^2
    response_time: float = quantity(
        low=0.0, unit="s", default=0.0
    )  #: first-order lag of the kinematic engine behind its set point; see docs/engine.md
    footprint: Array = quantity(
        shape=("V", 2), unit="m", default=[]
    )  #: convex outline, counter-clockwise; empty: from the URDF

    def __post_init__(self) -> None:
        wanted = JOINT_COUNT[self.base]
        if len(self.joints) != wanted:
            raise ConfigError(
                f"joints names {len(self.joints)} joints; a {self.base} base has {wanted}"
            )


@functools.cache
def shipped_models() -> dict[str, RobotModel]:
    """Read the models of ``robots/models.yaml`` by name, footprints filled in."""
    path = ROBOTS / "models.yaml"
    data = codec.read_yaml(path)
    return {name: _decode_model(entry, path, name) for name, entry in data.items()}


def find_model(name: str, *, where: str = "robots.model") -> RobotModel:
    """Find a model by its shipped name, or by the path of a model file.

    Args:
        name: a key of ``robots/models.yaml``, or a path that ends in .yaml or .yml.
        where: what error messages begin with.

    Returns:
        The model, ``urdf`` as an absolute path and ``footprint`` filled in.

    Raises:
        UnknownNameError: neither.
        InputError: the file or its URDF cannot be read or says something not allowed.
    """
    if name.endswith((".yaml", ".yml")):
        return _read_model(Path(name))
    models = shipped_models()
    if name not in models:
        raise UnknownNameError("robot model", name, models, where=where)
    return models[name]


def _read_model(path: Path) -> RobotModel:
    return _decode_model(codec.read_yaml(path), path, "")


def _decode_model(data: Any, path: Path, name: str) -> RobotModel:
    where = f"{path}: {name}" if name else str(path)
    model = codec.decode(RobotModel, data, where=where)
    urdf = (path.parent / model.urdf).resolve()
    wheels = model.joints if model.wheels_touch == "floor" else ()
    footprint = model.footprint
    if not len(footprint):
        footprint = read_footprint(urdf, without=wheels)
    elif len(footprint) < 3:
        raise ConfigError(f"{where}: footprint has {len(footprint)} corners; it needs at least 3")
    return replace(model, urdf=str(urdf), footprint=convex_outline(footprint, where))


@functools.lru_cache(maxsize=64)
def inner_disc(model: RobotModel) -> Disc:
    """Find the largest disc inside a body: it goes wherever the body does."""
    line = shapely.maximum_inscribed_circle(shapely.Polygon(model.footprint), DISC_ERROR)
    (x, y), _ = line.coords
    return Disc((x, y), line.length)
