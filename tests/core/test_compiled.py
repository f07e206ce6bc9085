from __future__ import annotations

from pathlib import Path

from mrta_falsify.core import compiled
from mrta_falsify.core.polyline import path_length


def _tree(root: Path, text: str) -> Path:
    for package in compiled.PACKAGES:
        (root / package).mkdir(parents=True, exist_ok=True)
    (root / "mrta_falsify" / "kernel.py").write_text(f"from numba import njit\n{text}\n")
    (root / "mrta_falsify" / "plain.py").write_text("A = 1\n")
    return root


def test_a_change_in_any_compiled_module_gives_another_cache(tmp_path):
    one = compiled.sources_digest(_tree(tmp_path / "a", "x = 1"))
    assert compiled.sources_digest(_tree(tmp_path / "b", "x = 1")) == one
    assert compiled.sources_digest(_tree(tmp_path / "c", "x = 2")) != one
    (tmp_path / "b" / "mrta_falsify" / "plain.py").write_text("A = 2\n")
    compiled.sources_digest.cache_clear()
    assert compiled.sources_digest(tmp_path / "b") == one


def test_our_caches_lie_in_a_folder_of_that_name_and_those_of_others_do_not():
    assert compiled.sources_digest() in path_length._cache.cache_path

    def foreign() -> int:
        return 1

    cached = compiled.njit(cache=True)(foreign)
    assert "compiled-" not in cached._cache.cache_path
