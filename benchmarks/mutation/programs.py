"""Requests about Scenic programs, which are compiled once each in this process."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import cube_of
from mrta_falsify.core.seeding import candidate_seed
from mrta_falsify.verbs.scene_rehearsal import look_at
from scenic_worlds.program import Program, compile_program, scenario_path


@functools.cache
def _open(scenario: str) -> Program:
    return compile_program(scenario_path(scenario))


def cube(request: dict[str, Any]) -> dict[str, Any]:
    """Describe the cube that a sampler searches."""
    return {"cube": codec.encode(cube_of(_open(request["scenario"]).space))}


def rehearse(request: dict[str, Any]) -> dict[str, Any]:
    """Measure what the scene at a point asks of a stack."""
    found = look_at(_open(request["scenario"]), request["u"], seed=request["seed"])
    if found is None:
        return {"rejected": "no scene"}
    return {"demands": found.demands.tolist(), "u": found.u.tolist()}


def realise(request: dict[str, Any]) -> dict[str, Any]:
    """Make the world of a candidate; of the uniform one, if there is no point."""
    program = _open(request["scenario"])
    seed, number = request["seed"], request["number"]
    asked = program.candidate(seed, number)
    if request["u"] is not None:
        u = np.asarray(request["u"], dtype=np.float64)
        asked = Candidate(number=number, u=u, seed=candidate_seed(seed, number))
    try:
        found = program.realise(asked)
    except InputError as error:
        return {"rejected": str(error)}
    if found.world.scripted:
        return {"rejected": f"the world needs its program, because of {found.world.scripted}"}
    return {"world": codec.encode(found.world), "u": found.candidate.u.tolist()}
