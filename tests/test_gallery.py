"""The gallery: its page says what its list and its worlds say."""

from __future__ import annotations

import re

import pytest

from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core.config import read_config
from mrta_falsify.trial import Job, campaign_specifications, judge
from scenic_worlds.program import compile_program
from tools import draw_gallery


def test_every_case_of_the_gallery_has_its_section_picture_and_commands():
    cases = draw_gallery.read_cases()
    page = draw_gallery.PAGE.read_text()
    assert len(cases) >= 5
    assert len({case.name for case in cases}) == len(cases)
    for case in cases:
        assert f"\n## {case.title}\n" in page
        assert (draw_gallery.FOLDER / f"{case.name}.png").stat().st_size < 250_000
        campaign = draw_gallery.on_lines([*case.words(), "-o", f"runs/{case.name}"])
        assert f"\n{campaign}\n" in page
        assert f"\nmrta-falsify replay runs/{case.name} {case.trial:04d} --verify 3\n" in page
        assert " ".join(case.why.split()) in " ".join(page.split())
    assert len(re.findall(r"^## ", page, re.MULTILINE)) == len(cases)


@pytest.mark.long
@pytest.mark.parametrize("case", draw_gallery.read_cases(), ids=lambda case: case.name)
def test_the_smallest_worlds_of_the_gallery_fail_as_it_says_or_pass_since(case):
    folder = draw_gallery.FOLDER / case.name
    program = folder / "world.min.scenic"
    wanted = program.read_text().splitlines()[0].rpartition(" fails with ")[2].strip('."')
    job = Job(
        world=compile_program(program).sample(0),
        config=read_config(folder / "stack.yaml"),
        specifications=campaign_specifications(),
        early_stop=True,
    )
    found = signature(judge(job, keep_trace=False).verdicts)
    assert found == ("" if case.since else wanted)
