"""Every Python block of the documentation runs as it stands."""

from __future__ import annotations

import ast
import re
import sys
import types
from pathlib import Path

import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.trace import COLUMNS
from tools import site_pages

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))


def _blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), re.DOTALL)


def _pages_with_python() -> list[object]:
    """List pages; one runs a whole campaign and explains, minimises and reports its failure."""
    marks = {"python": (pytest.mark.long, pytest.mark.timeout(1800))}  # it explains and minimises
    pages = [page for page in PAGES if _blocks(page, "python")]
    return [pytest.param(p, id=p.stem, marks=marks.get(p.stem, ())) for p in pages]


@pytest.mark.parametrize("page", _pages_with_python())
def test_the_python_of_a_page_runs_and_its_claims_hold(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType("documented")
    monkeypatch.setitem(sys.modules, "documented", module)  # dataclasses look their module up
    for block in _blocks(page, "python"):
        exec(compile(block, str(page), "exec"), module.__dict__)


def _documented_components():
    """Component classes of each extension point that the entry points of a page name."""
    found = {}
    for page in PAGES:
        text = "\n".join(_blocks(page, "toml"))
        for point, name in re.findall(r'"mrta_falsify\.(\w+)"\]\n\w+ = "[\w.]+:(\w+)"', text):
            found[point] = (page, name)
    return found


def test_every_extension_point_with_a_component_has_an_example_with_its_entry_point():
    examples = _documented_components()
    points = {point for point in registry.EXTENSION_POINTS if registry.names(point)}
    assert points - set(examples) == set()
    for point in points:
        page, name = examples[point]
        assert f"class {name}:" in "\n".join(_blocks(page, "python")), point


def _kinds_of_events(path):
    """Texts that a module gives to an event as its kind, also by a variable of that name."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("StackEvent", ".event")):
            found += [keyword.value for keyword in node.keywords if keyword.arg == "kind"]
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "kind":
            found.append(node.value)
        elif isinstance(node, ast.For) and ast.unparse(node.target).strip("()").startswith(
            "kind, "
        ):
            pairs = node.iter.elts if isinstance(node.iter, ast.Tuple) else []
            found += [pair.elts[0] for pair in pairs]
    texts = [ast.walk(part.test) if isinstance(part, ast.IfExp) else () for part in found]
    skipped = {id(node) for test in texts for node in test}
    return {
        node.value
        for part in found
        for node in ast.walk(part)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if id(node) not in skipped
    }


def test_every_kind_of_event_that_the_stack_writes_is_documented():
    sources = (ROOT / "mrta_falsify" / "stack").rglob("*.py")
    kinds = {kind for path in sources for kind in _kinds_of_events(path)}
    assert {"comms-lost", "dropped-off", "released", "replanned", "waits-for"} <= kinds
    assert {"granted", "no-path"} <= kinds
    page = (ROOT / "docs" / "world.md").read_text()
    assert {kind for kind in kinds if f"`{kind}`" not in page} == set()


def test_every_column_of_a_trace_is_documented_with_its_shape():
    page = site_pages.columns_table()
    rows = re.findall(r"^\| `(\w+)` \| \((.+)\) \| (.+) \|$", page, re.MULTILINE)
    assert [name for name, _, _ in rows] == list(COLUMNS)
    assert ("pose", "K, N, 3") in [row[:2] for row in rows]
    assert ("time", "K,") in [row[:2] for row in rows]
    assert all(text.strip() for _, _, text in rows)


def test_every_table_that_a_page_leaves_to_the_site_is_made():
    marks = {name for page in PAGES for name in re.findall("<!-- made: (.+) -->", page.read_text())}
    assert marks == set(site_pages.TABLES)


def test_every_module_that_the_glossary_names_exists():
    text = (ROOT / "docs" / "glossary.md").read_text()
    terms = re.findall(r"^- \*\*(.+?)\*\*", text, re.MULTILINE)
    modules = re.findall(r"`([a-z_]+(?:\.[a-z_]+)+)`", text)
    assert len(terms) == len(set(terms)) == len(modules) > 40
    files = [ROOT.joinpath(*module.split(".")) for module in modules]
    missing = [str(f) for f in files if not (f.is_dir() or f.with_suffix(".py").is_file())]
    assert missing == []
