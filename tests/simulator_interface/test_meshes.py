"""Shapes of furniture stay inside their boxes and are always the same."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from mrta_falsify.core.errors import UnknownNameError
from simulator_interface.furniture_shapes import build_mesh, mesh_names


@pytest.mark.parametrize("name", mesh_names())
@pytest.mark.parametrize("size", [(2.2, 1.0, 0.95), (0.4, 0.4, 0.6), (0.15, 1.8, 1.9)])
def test_a_shape_fills_its_box_and_stays_inside(name, size):
    length, width, height = size
    mesh = build_mesh(name, length=length, width=width, height=height)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    reach = np.array([length / 2, width / 2])
    assert (low >= np.array([*-reach, 0.0]) - 1e-9).all()
    assert (high <= np.array([*reach, height]) + 1e-9).all()
    assert low[2] == pytest.approx(0.0, abs=1e-9)
    assert high[2] == pytest.approx(height, rel=0.03)


@pytest.mark.parametrize("name", mesh_names())
def test_a_shape_is_closed_and_built_the_same_each_time(name):
    first = build_mesh(name, length=0.9, width=0.6, height=1.0)
    again = build_mesh(name, length=0.9, width=0.6, height=1.0)
    assert np.array_equal(first.vertices, again.vertices)
    assert np.array_equal(first.faces, again.faces)
    assert trimesh.Trimesh(first.vertices, first.faces, process=False).is_watertight


def test_an_unknown_shape_is_refused_with_the_nearest_name():
    with pytest.raises(UnknownNameError, match="did you mean 'bookshelf'"):
        build_mesh("bokshelf", length=1, width=1, height=1)


def test_every_class_of_the_library_names_a_shape_that_exists():
    import re
    from pathlib import Path

    text = (Path(__file__).parents[2] / "scenic_worlds" / "furniture.scenic").read_text()
    named = set(re.findall(r"^    mesh: '(\w+)'$", text, re.MULTILINE))
    assert named
    assert named <= set(mesh_names())
