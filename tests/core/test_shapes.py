"""Outlines as polygons."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from mrta_falsify.core.shapes import polygons

triangles_and_more = st.integers(3, 8).flatmap(
    lambda corners: st.lists(
        st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
        min_size=corners,
        max_size=corners,
    ).map(np.array)
)


@given(st.lists(triangles_and_more, max_size=5))
def test_polygons_are_those_that_are_built_one_by_one(outlines):
    built = polygons(outlines)
    assert len(built) == len(outlines)
    for one, outline in zip(built, outlines, strict=True):
        assert shapely.equals_identical(one, shapely.Polygon(outline))
