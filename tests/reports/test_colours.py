from __future__ import annotations

import re

from mrta_falsify.core.fleet import Phase
from reports.colours import PAGE, PAINTS, PHASES, css_variables
from reports.floor_scene import Role


def test_every_colour_of_a_page_has_a_name_of_its_own():
    for sheet in css_variables().split("@media"):  # light, dark by wish, dark by button
        names = re.findall(r"(--[\w-]+):", sheet)
        assert len(names) == len(set(names)) == 2 * len(PAINTS) + len(PHASES) + len(PAGE)


def test_text_of_a_page_can_be_read_on_its_grounds():
    for which in (0, 1):
        for ground in ("paper", "back"):
            for text in ("ink", "soft", "bad", "good", "link"):
                assert _contrast(PAGE[text][which], PAGE[ground][which]) >= 4.5, (text, ground)


def _contrast(one: str, other: str) -> float:
    """Contrast ratio of WCAG 2."""
    low, high = sorted(_luminance(colour) for colour in (one, other))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    shares = [value / 255.0 for value in bytes.fromhex(colour[1:])]
    linear = [s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_every_phase_but_off_has_a_colour():
    assert set(PHASES) == set(Phase) - {Phase.OFF}


def test_every_role_that_stands_still_has_a_paint():
    moving = {Role.ROUTE, Role.TRAIL, Role.PATH, Role.ROBOT}
    assert set(PAINTS) == set(Role) - moving
