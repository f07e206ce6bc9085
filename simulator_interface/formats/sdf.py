"""SDF worlds: what their static models put in a robot's way.

Every collision shape of a static model (its visual shapes if it has none) is cut by the slab
of heights that a robot fills, and becomes furniture. Files count as untrusted: document
types and entities are refused, and nothing outside the world's folder is read.

Reference: http://sdformat.org/spec (1.4 to 1.9); poses are x y z roll pitch yaw.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.world import Furniture
from simulator_interface.formats.sdf_places import SdfPlace
from simulator_interface.formats.sdf_shapes import footprints_of_model
from simulator_interface.formats.xml_files import Node, read_xml

MAX_NESTING = 20  # of models that include models
MAX_MODELS = 20_000
IGNORED = ("sun", "ground_plane")  # models of Gazebo that are not obstacles


def read_sdf(
    path: Path, *, low: float = 0.05, high: float = 0.5, skip: tuple[str, ...] = ()
) -> tuple[Furniture, ...]:
    """Read obstacles from the static models of an SDF world, or of one model.

    Args:
        path: the file. Models that it includes are looked up beside it as ``NAME`` or
            ``models/NAME``, meshes beside the file that names them; all must lie in the
            folder of ``path``.
        low: lowest height at which robots touch things [m].
        high: highest such height [m].
        skip: names of models to leave out.

    Returns:
        Footprints ``model/link/collision`` within the slab, kind "static".

    Raises:
        FormatError: a file cannot be read or is broken; a model or mesh is not there; a
            pose or size is not allowed.
    """
    root = path.parent.resolve()
    top = read_xml(path, "sdf")
    worlds = top.findall("world")
    holders = worlds if worlds else [top]
    place = SdfPlace(path, root, np.eye(4), "")
    found: list[Furniture] = []
    left = itertools.count()
    for holder in holders:
        for model, where in _models(holder, place, frozenset(skip), left):
            found += footprints_of_model(model, where, low, high)
    return tuple(found)


# --- models ------------------------------------------------------------------------------


def _is_true(node: Node, tag: str) -> bool:
    return (node.findtext(tag) or "").strip().lower() in ("true", "1")


def _models(
    holder: Node, place: SdfPlace, skip: frozenset[str], count: Iterator[int]
) -> Iterator[tuple[Node, SdfPlace]]:
    """Static models of a world or model, at any depth, each with its place."""
    for child in holder:
        if child.tag not in ("model", "include"):
            continue
        if next(count) >= MAX_MODELS:
            raise place.fail(f"has more than {MAX_MODELS} models")
        if child.tag == "model":
            name = child.get("name", "")
            if name in skip:
                continue
            where = place.inside(child, name)
            yield from _whole(child, where, skip, count, static=_is_true(child, "static"))
        else:
            yield from _included(child, place, skip, count)


def _whole(
    model: Node, where: SdfPlace, skip: frozenset[str], count: Iterator[int], *, static: bool
) -> Iterator[tuple[Node, SdfPlace]]:
    """A model, if it is static, and the models inside it."""
    if static:
        yield model, where
        for inner in model.findall("model"):
            # What is part of a static model does not move either.
            name = inner.get("name", "")
            yield from _whole(inner, where.inside(inner, name), skip, count, static=True)
        for include in model.findall("include"):
            yield from _included(include, where, skip, count, static=True)
        return
    yield from _models(model, where, skip, count)


def _included(
    include: Node,
    place: SdfPlace,
    skip: frozenset[str],
    count: Iterator[int],
    *,
    static: bool = False,
) -> Iterator[tuple[Node, SdfPlace]]:
    uri = (include.findtext("uri") or "").strip()
    if not uri.startswith("model://"):
        raise place.fail(f"<uri> is {uri[:80]!r}; only model://NAME is read")
    model_name = uri.removeprefix("model://").strip("/")
    name = (include.findtext("name") or model_name).strip()
    if model_name in IGNORED or model_name in skip or name in skip:
        return
    if place.nesting >= MAX_NESTING:
        raise place.fail(f"models include each other more than {MAX_NESTING} deep ({uri})")
    file = _model_file(model_name, place)
    models = read_xml(file, "sdf").findall("model")
    if not models:
        raise FormatError(f"{file}: has no <model>")
    model = models[0]
    # The pose of an <include> takes the place of the model's own.
    holder = include if include.find("pose") is not None else model
    at = place.inside(holder, name)
    where = SdfPlace(file, place.root, at.matrix, at.name, place.nesting + 1)
    given = include.find("static")
    own = _is_true(model, "static") if given is None else _is_true(include, "static")
    yield from _whole(model, where, skip, count, static=static or own)


def _model_file(model: str, place: SdfPlace) -> Path:
    """The SDF file of ``model://NAME``."""
    for folder in (place.root / model, place.root / "models" / model):
        for file in (folder / "model.sdf", *sorted(folder.glob("*.sdf"))):
            if file.is_file() and file.resolve().is_relative_to(place.root):
                return file
    raise place.fail(
        f"model://{model} is not in {place.root} or its folder models; copy it there, or name "
        "it in `skip`"
    )
