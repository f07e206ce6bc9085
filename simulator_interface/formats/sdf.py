"""SDF worlds: what their static models put in a robot's way.

Every collision shape of a static model (its visual shapes if it has none) is cut by the slab
of heights that a robot fills, and becomes furniture. Files count as untrusted: document
types and entities are refused, and nothing outside the world's folder is read. Sun and ground plane
are no obstacles, wherever they come from.

Reference: http://sdformat.org/spec (1.4 to 1.9); poses are x y z roll pitch yaw.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.world import Furniture
from simulator_interface.formats.sdf_places import SdfPlace, last_part
from simulator_interface.formats.sdf_shapes import footprints_of_model
from simulator_interface.formats.xml_files import Node, read_xml

MAX_NESTING = 20  # of models that include models
MAX_MODELS = 20_000


def read_sdf(
    path: Path, *, low: float = 0.05, high: float = 0.5, skip: tuple[str, ...] = ()
) -> tuple[Furniture, ...]:
    """Read obstacles from the static models of an SDF world, or of one model.

    Args:
        path: the file. Models that it includes are looked up beside it as ``NAME`` or
            ``models/NAME``, NAME being the last part of their URI, meshes beside the file that
            names them; all must lie in the folder of ``path``.
        low: lowest height at which robots touch things [m].
        high: highest such height [m].
        skip: names of models, links, shapes and URIs to leave out; the last part of one is
            enough.

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
    place = SdfPlace(path, root, np.eye(4), "", skip=frozenset(skip))
    found: list[Furniture] = []
    left = itertools.count()
    for holder in holders:
        for model, where in _models(holder, place, left):
            found += footprints_of_model(model, where, low, high)
    return tuple(found)


# --- models ------------------------------------------------------------------------------


def _is_true(node: Node, tag: str) -> bool:
    return (node.findtext(tag) or "").strip().lower() in ("true", "1")


def _models(holder: Node, place: SdfPlace, count: Iterator[int]) -> Iterator[tuple[Node, SdfPlace]]:
    """Static models of a world or model, at any depth, each with its place."""
    for child in holder:
        if child.tag not in ("model", "include"):
            continue
        if next(count) >= MAX_MODELS:
            raise place.fail(f"has more than {MAX_MODELS} models")
        if child.tag == "model":
            name = child.get("name", "")
            static = _is_true(child, "static")
            if place.is_left_out(name) or not (static or _holds_models(child)):
                continue
            yield from _whole(child, place.inside(child, name), count, static=static)
        else:
            yield from _included(child, place, count)


def _holds_models(model: Node) -> bool:
    return model.find("model") is not None or model.find("include") is not None


def _whole(
    model: Node, where: SdfPlace, count: Iterator[int], *, static: bool
) -> Iterator[tuple[Node, SdfPlace]]:
    """A model, if it is static, and the models inside it."""
    if static:
        yield model, where
        for inner in model.findall("model"):
            # What is part of a static model does not move either.
            name = inner.get("name", "")
            if not where.is_left_out(name):
                yield from _whole(inner, where.inside(inner, name), count, static=True)
        for include in model.findall("include"):
            yield from _included(include, where, count, static=True)
        return
    yield from _models(model, where, count)


def _included(
    include: Node, place: SdfPlace, count: Iterator[int], *, static: bool = False
) -> Iterator[tuple[Node, SdfPlace]]:
    uri = (include.findtext("uri") or "").strip()
    name = (include.findtext("name") or last_part(uri)).strip()
    if place.is_left_out(uri, name):
        return
    if not last_part(uri):
        raise place.fail("<uri> of an <include> is empty; it names a model, as model://NAME")
    if place.nesting >= MAX_NESTING:
        raise place.fail(f"models include each other more than {MAX_NESTING} deep ({uri})")
    file = _model_file(uri, place)
    models = read_xml(file, "sdf").findall("model")
    if not models:
        raise FormatError(f"{file}: has no <model>")
    model = models[0]
    # The pose of an <include> takes the place of the model's own.
    holder = include if include.find("pose") is not None else model
    at = place.inside(holder, name)
    where = dataclasses.replace(at, file=file, nesting=place.nesting + 1)
    given = include.find("static")
    own = _is_true(model, "static") if given is None else _is_true(include, "static")
    yield from _whole(model, where, count, static=static or own)


def _model_file(uri: str, place: SdfPlace) -> Path:
    """The SDF file of a model, by the last part of its URI; nothing is fetched."""
    model = last_part(uri)
    for folder in (place.root / model, place.root / "models" / model):
        for file in (folder / "model.sdf", *sorted(folder.glob("*.sdf"))):
            if file.is_file() and file.resolve().is_relative_to(place.root):
                return file
    raise place.fail(
        f"{uri[:80]} is not in {place.root} or its folder models; copy it there as {model!r}, or "
        f"leave it out by `skip: [{model}]`"
    )
