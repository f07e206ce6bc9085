from __future__ import annotations

import re

from mrta_falsify.core.fleet import Phase
from reports.colours import PAINTS, PHASES, css_variables
from reports.floor_scene import Role


def test_every_colour_of_a_page_has_a_name_of_its_own():
    light, dark = css_variables().split("@media")
    for sheet in (light, dark):
        names = re.findall(r"(--[\w-]+):", sheet)
        assert len(names) == len(set(names)) == 2 * len(PAINTS) + len(PHASES)


def test_every_phase_but_off_has_a_colour():
    assert set(PHASES) == set(Phase) - {Phase.OFF}


def test_every_role_that_stands_still_has_a_paint():
    moving = {Role.ROUTE, Role.TRAIL, Role.PATH, Role.ROBOT}
    assert set(PAINTS) == set(Role) - moving
