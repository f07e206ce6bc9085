"""The documentation as a site: built without a warning, whole, and readable offline."""

from __future__ import annotations

import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import click
import pytest

import mrta_falsify as mf
from mrta_falsify.cli import main
from mrta_falsify.cli.group import COMMANDS
from mrta_falsify.core import registry
from scenic_worlds.zoo import scene_names
from tests.browser import browser, find
from tools.site_pages import PRINTED

pytestmark = pytest.mark.long  # builds the site, in about 10 s of CPU

ROOT = Path(__file__).parent.parent
PHONE = 390  # px


class Page(HTMLParser):
    """What a page of HTML links to, loads and names."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.names: set[str] = set()
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        self.names |= {given[key] for key in ("id", "name") if key in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload"):
            self.loaded.append(given["href"])
        elif "src" in given:
            self.loaded.append(given["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        capture_output=True, text=True, cwd=ROOT, check=False,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site) -> dict[Path, Page]:
    return {path: Page(path) for path in site.rglob("*.html") if path.name != "404.html"}


def test_every_link_of_the_site_leads_to_a_file_and_a_place_in_it(pages):
    missing = []
    for path, page in pages.items():
        for link in page.links:
            name, _, anchor = unquote(link).partition("#")
            if "://" in name or name.startswith("mailto:"):
                continue
            target = Path(os.path.normpath(path.parent / name)) if name else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file() or (anchor and anchor not in pages[target].names):
                missing.append((path.name, link))
    assert missing == []


def test_pages_load_nothing_from_the_net(site, pages):
    for path, page in pages.items():
        for name in page.loaded:
            assert "//" not in name, path
            assert name.startswith("data:") or (path.parent / unquote(name)).is_file(), path


def test_every_command_and_every_public_name_is_on_the_site(site, pages):
    assert set(COMMANDS) <= pages[site / "options.html"].names
    told = pages[site / "api/commands.html"].names | pages[site / "api/values.html"].names
    assert {home.replace(":", ".") for home in mf.HOMES.values()} <= told
    assert "mrta_falsify.core.protocols.Sampler" in pages[site / "api/protocols.html"].names
    components = {name for point in registry.EXTENSION_POINTS for name in registry.names(point)}
    assert components <= pages[site / "components.html"].names
    assert {"frame", "sensed", "controlview"} <= pages[site / "fields.html"].names


def test_the_fields_of_every_json_and_every_scene_of_the_zoo_are_on_the_site(site, pages):
    has_json = {
        name
        for name in COMMANDS
        for option in main.get_command(click.Context(main), name).params
        if isinstance(option.type, click.Choice) and "json" in option.type.choices
    }
    by_hand = {"show", "plugins"}  # told in words on the page of commands
    assert has_json - by_hand == set(PRINTED) - {"sample"}
    assert set(PRINTED) <= pages[site / "json.html"].names
    text = (site / "zoo.html").read_text()
    assert scene_names()
    assert [name for name in scene_names() if f"pictures/zoo/{name}.png" not in text] == []


@pytest.mark.browser
@pytest.mark.skipif(find() is None, reason="no Chromium on this machine")
def test_the_site_is_searched_offline_and_fits_a_phone(site):
    with browser() as page:
        page.open(site / "index.html")
        page.value("document.querySelector('input[name=query]').focus()")
        page.value(
            "(() => { const q = document.querySelector('input[name=query]'); q.value = 'knife'; "
            "for (const kind of ['keyup', 'input']) "
            "q.dispatchEvent(new Event(kind, {bubbles: true})); })()"
        )
        page.wait("document.querySelectorAll('.md-search-result__item').length > 0")
        for name in (
            "index",
            "commands",
            "options",
            "evaluation",
            "api/commands",
            "first-campaign",
        ):
            page.open(site / f"{name}.html", width=PHONE, height=844, mobile=True)
            assert page.value("document.documentElement.scrollWidth") <= PHONE, name
        assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []
        assert page.errors == []
