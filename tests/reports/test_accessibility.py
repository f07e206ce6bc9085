"""Pages without violations of axe-core's rules, in light and dark, wide and narrow.

Needs Chromium and axe-core, which is no part of this project:
``npm install --prefix /tmp/axe axe-core@4.10.3``, or ``AXE_CORE=PATH`` of its ``axe.min.js``.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mrta_falsify.commands import report as reporting
from mrta_falsify.commands.stored_trials import open_campaign
from tests import browser

AXE = Path(os.environ.get("AXE_CORE", "/tmp/axe/node_modules/axe-core/axe.min.js"))
CAMPAIGN = Path(__file__).parents[1] / "recorded" / "campaigns" / "beds"
FOUND = """axe.run(document, {resultTypes: ['violations']}).then((r) => r.violations.map(
  (v) => `${v.id}: ${v.nodes.map((n) => n.target.join(' ')).slice(0, 5).join(' | ')}`))"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    if browser.find() is None or not AXE.is_file():
        pytest.skip("needs Chromium and axe-core")
    folder = tmp_path_factory.mktemp("pages")
    reporting.write_report(open_campaign(CAMPAIGN), folder / "report.html")
    with browser.browser() as running:
        running.patience = 300.0  # with every folded part open, the rules take a while
        yield running, folder


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_violates_no_rule_of_accessibility(pages, width, scheme):
    running, folder = pages
    media = [{"name": "prefers-color-scheme", "value": scheme}]
    running.send("Emulation.setEmulatedMedia", features=media)
    running.open(folder / "report.html", width=width, mobile=width < 500)
    running.value("for (const d of document.querySelectorAll('details')) d.open = true")
    running.value("document.querySelector('.trials').scrollIntoView()")
    running.wait("document.querySelector('.trials').table !== undefined")
    running.value(AXE.read_text(encoding="utf-8") + "; 1")
    assert running.value(FOUND) == []
