"""What is usual in Scenic and defeats a campaign: properties as requirements, Scenic's samplers."""

from __future__ import annotations

import re
from collections.abc import Iterator

from scenic.core.requirements import CompiledRequirement
from scenic.core.scenarios import Scenario

from scenic_worlds.lint.program_lines import Lint, ProgramText
from scenic_worlds.requirements import requirement_file

SAMPLER_PARAMS = (
    "externalSampler",
    "externalSamplerRejectionFeedback",
    "verifaiSamplerParams",
    "verifaiSamplerType",
)

# --- properties under test ---------------------------------------------------------------------


def temporal_requirements(scenario: Scenario) -> Iterator[Lint]:
    """Find requirements on what happens during a run."""
    for requirement in scenario.requirements:
        if not requirement.proposition.has_temporal_operator:
            continue
        place = _requirement_place(requirement)
        given = str(requirement.name or "")
        name = "" if given == f"requirement on line {requirement.line}" else given
        yield Lint(
            where=place,
            code="property-as-requirement",
            name=name or "require",
            message="a temporal require throws away every run that violates it; to find such "
            "runs, leave it out and name a specification, as --spec stl:FORMULA",
        )


def requirements_while_running(program: ProgramText) -> Iterator[Lint]:
    """Find each ``require`` inside a block that runs during a simulation."""
    block, depth = "", 0
    for number, line in enumerate(program.lines, start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        indent = len(line) - len(line.lstrip())
        if block and indent <= depth:
            block = ""
        header = re.match(r"(monitor|behavior)\s+(\w+)", text)
        if header and text.endswith(":"):
            block, depth = f"{header[1]} {header[2]}", indent
        elif block and re.match(r"require\b", text):
            yield Lint(
                where=program.at(number),
                code="property-as-requirement",
                name=block,
                message=f"require inside {block} throws away every run that violates it; to find "
                "such runs, leave it out and name a specification, as --spec stl:FORMULA",
            )


def _requirement_place(requirement: CompiledRequirement) -> str:
    return f"{requirement_file(requirement)}:{requirement.line}"


# --- samplers ------------------------------------------------------------------------------------


def ignored_samplers(scenario: Scenario, program: ProgramText) -> Iterator[Lint]:
    """Find parameters of VerifAI's samplers."""
    for name in SAMPLER_PARAMS:
        if name in scenario.params:
            yield Lint(
                where=program.param(name),
                code="sampler-ignored",
                name=f"param {name}",
                message=f"param {name} has no effect here; choose a sampler with "
                "`mrta-falsify campaign --sampler NAME`",
            )
