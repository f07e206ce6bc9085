"""Mutants are valid, different, on their places, and refused where they do not fit."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from benchmarks.mutation.layers import layer_of, stack_files
from benchmarks.mutation.mutants import (
    Edit,
    Mutant,
    StaleMutantError,
    mutated_texts,
    read_mutants,
    read_patch,
    text_digest,
    write_mutants,
)
from benchmarks.mutation.places import draw_mutants, edit_of, places_of
from mrta_falsify.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
PATH = "mrta_falsify/stack/route.py"


def changed(text: str, edit: Edit) -> str:
    lines = text.split("\n")
    lines[edit.line - 1 : edit.line - 1 + len(edit.lines)] = edit.after.split("\n")
    return "\n".join(lines)


def mutations(text: str) -> set[tuple[str, str]]:
    """Operator and mutated text of every change of a text."""
    found = set()
    for place in places_of(PATH, text):
        for slip in place.slips:
            edit = edit_of(place.source, slip)
            assert edit is not None
            found.add((slip.change.operator, changed(text, edit)))
    return found


@pytest.mark.parametrize(
    ("text", "operator", "wanted"),
    [
        ("x = a < b", "boundary", "x = a <= b"),
        ("x = a >= b", "comparison", "x = a <= b"),
        ("x = a is None", "comparison", "x = a is not None"),
        ("x = a * (b + c)", "arithmetic", "x = a * (b - c)"),
        ("x = a * b * c", "arithmetic", "x = a / b * c"),
        ("x += y", "arithmetic", "x -= y"),
        ("x = a and b", "and for or", "x = a or b"),
        ("x = c * (a and b)", "and for or", "x = c * (a or b)"),
        ("x = not a", "dropped not", "x = a"),
        ("x = -a", "dropped sign", "x = a"),
        ("REACH = 0.5  # m", "constant", "REACH = 1.0  # m"),
        ("REACH = 0.5  # m", "constant", "REACH = 0.25  # m"),
        ("x = True", "constant", "x = False"),
        ("x = range(n)", "off by one", "x = range(n - 1)"),
        ("x = a[1:]", "off by one", "x = a[2:]"),
        ("x = a[-1]", "off by one", "x = a[-2]"),
        ("x = a[i, 0]", "off by one", "x = a[i, 1]"),
        ("x = f(a, b, c)", "swapped arguments", "x = f(a, c, b)"),
        ("x = min(a, 2)", "counterpart", "x = max(a, 2)"),
        ("x = np.argmax(a)", "counterpart", "x = np.argmin(a)"),
        ("if a and b:\n    c = d", "negated condition", "if not (a and b):\n    c = d"),
        ("events.append(a)", "deleted call", "pass"),
        ("self.x = a", "deleted assignment", "pass"),
        ("for i in a:\n    break", "deleted break", "for i in a:\n    continue"),
        (
            "def f():\n    if a < b:\n        return c\n    return d",
            "deleted return",
            "def f():\n    if False:\n        return c\n    return d",
        ),
        ("x = 'ä', a < b", "boundary", "x = 'ä', a <= b"),
    ],
)
def test_an_operator_changes_the_text_as_its_name_says(text, operator, wanted):
    assert (operator, wanted) in mutations(text)


@pytest.mark.parametrize(
    "text",
    [
        '"""A text: 1 < 2."""',
        "if x < 0:\n    raise ConfigError(f'{x + 1}')",
        "assert x < 1",
        "from a import b",
        "if TYPE_CHECKING:\n    x = 1",
        "x: Array[1] = y",
        "__all__ = [a[1]]",
        "def _check_it():\n    x = 1",
        "def __init__(self, a):\n    self.a = a",
        "x = quantity(low=0.0, high=1.0, unit='m', default=y)",
    ],
)
def test_what_decides_nothing_is_left_alone(text):
    assert mutations(text) == set()


@pytest.mark.parametrize(
    "path", ["mrta_falsify/stack/waypoints.py", "mrta_falsify/stack/resources/crossings.py"]
)
def test_every_mutation_of_a_file_of_the_stack_is_another_valid_program(path):
    text = (ROOT / path).read_text(encoding="utf-8")
    original = ast.dump(ast.parse(text))
    found = [text for _, text in mutations(text)]
    assert len(found) > 20
    dumps = {ast.dump(ast.parse(text)) for text in found}
    assert original not in dumps


def test_mutants_are_drawn_from_each_layer_and_from_each_place_at_most_once(tmp_path):
    for path in ("mrta_falsify/stack/route.py", "mrta_falsify/stack/control/qp.py"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("def f(a, b):\n    return a < b, a + b, a * b, a[0]\n")
    drawn = draw_mutants(tmp_path, count=6, seed=3)
    assert drawn == draw_mutants(tmp_path, count=6, seed=3)
    assert drawn != draw_mutants(tmp_path, count=6, seed=4)
    assert [mutant.layer for mutant in drawn] == ["", "controller"] * 3
    assert len({(mutant.module, mutant.edits[0].after) for mutant in drawn}) == 6
    assert len(draw_mutants(tmp_path, count=99, seed=3)) == 8
    for mutant in drawn:
        (text,) = mutated_texts(mutant, tmp_path).values()
        ast.parse(text)


def test_mutants_may_be_drawn_from_reached_lines_only(tmp_path):
    (tmp_path / PATH).parent.mkdir(parents=True)
    (tmp_path / PATH).write_text(
        "def f(a, b):\n    if a < b:\n        return a + 1\n    return b\n"
    )
    drawn = draw_mutants(tmp_path, count=99, seed=0, may_change={PATH: {2}})
    assert {mutant.edits[0].line for mutant in drawn} == {2}


def test_the_stack_is_whole_and_each_layer_has_files():
    files = stack_files(ROOT)
    assert "mrta_falsify/stack/control/qp.py" in files
    assert "simulator_interface/inflation.py" in files
    assert "mrta_falsify/stack/humans.py" not in files
    assert layer_of("mrta_falsify/stack/resources/queue.py") == "queue_policy"
    assert layer_of("mrta_falsify/stack/pipeline.py") == ""


# --- lists, patches, refusals ----------------------------------------------------------------


@pytest.fixture
def tree(tmp_path):
    (tmp_path / PATH).parent.mkdir(parents=True)
    (tmp_path / PATH).write_text("a = 1\nb = 2\nc = 3\n")
    return tmp_path


def mutant(**changes):
    edit = {"path": PATH, "line": 2, "before": "b = 2", "after": "b = 4\nd = 5", **changes}
    return Mutant(id="mine", edits=(Edit(**edit),))


def test_a_mutant_is_applied_to_the_text_alone(tree):
    assert mutated_texts(mutant(), tree) == {PATH: "a = 1\nb = 4\nd = 5\nc = 3\n"}
    assert (tree / PATH).read_text() == "a = 1\nb = 2\nc = 3\n"


def test_several_edits_of_a_file_keep_their_lines(tree):
    first = Edit(path=PATH, line=1, before="a = 1", after="a = 0\na = 1")
    both = Mutant(id="both", edits=(first, *mutant().edits))
    assert mutated_texts(both, tree) == {PATH: "a = 0\na = 1\nb = 4\nd = 5\nc = 3\n"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"before": "b = 3"}, r"route.py:2: reads 'b = 2'; the mutant was made for 'b = 3'"),
        ({"line": 9}, r"route.py:9: reads ''"),
        ({"line": 0}, r"route.py:0"),
        ({"path": "mrta_falsify/stack/gone.py"}, "gone.py: there is no such file"),
        ({"digest": "0" * 12}, "was changed since the mutant was made"),
    ],
)
def test_a_stale_mutant_is_refused_in_words(tree, changes, words):
    with pytest.raises(StaleMutantError, match=f"mutant mine: .*{words}"):
        mutated_texts(mutant(**changes), tree)


def test_a_mutant_with_the_digest_of_its_file_fits(tree):
    digest = text_digest((tree / PATH).read_text())
    assert mutated_texts(mutant(digest=digest), tree)


def test_a_list_of_mutants_is_read_as_it_was_written(tmp_path):
    write_mutants([mutant()], tmp_path / "mutants.json")
    assert read_mutants(tmp_path / "mutants.json") == (mutant(),)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "must be a list"),
        ('[{"id": "a", "edits": []}]', "changes nothing"),
        ('[{"id": "a/b", "edits": []}]', "names must be unique"),
        ('[{"id": "a", "edits": [{"path": "x"}]}]', "line"),
    ],
)
def test_a_list_that_is_none_is_refused(tmp_path, text, words):
    (tmp_path / "list.json").write_text(text)
    with pytest.raises(InputError, match=words):
        read_mutants(tmp_path / "list.json")


PATCH = f"""diff --git a/{PATH} b/{PATH}
--- a/{PATH}
+++ b/{PATH}
@@ -1,3 +1,4 @@
 a = 1
-b = 2
+b = 4
+d = 5
 c = 3
"""


def test_a_folder_of_patches_is_a_list_of_mutants(tree, tmp_path):
    (tmp_path / "patches").mkdir()
    (tmp_path / "patches" / "slip.patch").write_text(PATCH)
    (found,) = read_mutants(tmp_path / "patches")
    assert found.id == "slip"
    assert found.what == "b = 2 -> b = 4 d = 5"
    assert mutated_texts(found, tree) == {PATH: "a = 1\nb = 4\nd = 5\nc = 3\n"}


@pytest.mark.parametrize(
    ("text", "words"), [("no patch", "has no hunk"), (PATCH[:-20], "instead of 3")]
)
def test_a_damaged_patch_is_refused(tmp_path, text, words):
    (tmp_path / "slip.patch").write_text(text)
    with pytest.raises(InputError, match=words):
        read_patch(tmp_path / "slip.patch")


def test_a_folder_without_patches_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no \*.patch"):
        read_mutants(tmp_path)
