from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from mrta_falsify.core import compiled
from mrta_falsify.core.polyline import path_length


def _tree(root: Path, constant: str) -> Path:
    package = root / "mrta_falsify" / "core"
    package.mkdir(parents=True)
    (package / "lengths.py").write_text(f"NEAR = {constant}\n")
    (package / "apart.py").write_text(f"FAR = {constant}\n")
    kernel = package / "kernel.py"
    kernel.write_text("from mrta_falsify.core.lengths import NEAR\n\nprint(NEAR)\n")
    return kernel


def test_a_module_gets_another_cache_if_what_it_imports_changes(tmp_path):
    one, same, other = (
        compiled.digest_of_module(_tree(tmp_path / name, constant), tmp_path / name)
        for name, constant in (("a", "1.0"), ("b", "1.0"), ("c", "2.0"))
    )
    assert one == same
    assert one != other


def test_what_a_module_does_not_import_leaves_its_cache_alone(tmp_path):
    one = compiled.digest_of_module(_tree(tmp_path / "a", "1.0"), tmp_path / "a")
    kernel = _tree(tmp_path / "b", "1.0")
    (kernel.parent / "apart.py").write_text("FAR = 9.0\n")
    assert compiled.digest_of_module(kernel, tmp_path / "b") == one


def test_our_caches_lie_in_a_folder_of_that_name_and_those_of_others_do_not():
    path_length(np.zeros((2, 2)))
    folder = f"compiled-{compiled.digest_of_module(Path(path_length.py_func.__code__.co_filename))}"
    assert Path(path_length.stats.cache_path).name == folder

    def foreign() -> int:
        return 1

    cached = compiled.njit(cache=True)(foreign)
    assert "compiled-" not in cached.stats.cache_path


def test_compiling_is_told_and_a_compiled_call_is_not():
    told = []
    compiled.on_compiling(lambda: told.append("begins"), lambda: told.append("ends"))

    @compiled.njit
    def inner(x):
        return x + 1.0

    @compiled.njit
    def outer(x):
        return inner(x) * 2.0

    assert outer(1.0) == 4.0
    assert told == ["begins", "ends"]
    assert outer(2.0) == 6.0
    assert told == ["begins", "ends"]


def _kernel(folder: Path):
    """Import a module with a compiled function anew."""
    path = folder / "kernel_of_a_test.py"
    path.write_text(
        "from numba import njit\n\n\n@njit(cache=True)\ndef double(x):\n    return 2.0 * x\n"
    )
    spec = importlib.util.spec_from_file_location("kernel_of_a_test", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.double


def test_a_cache_that_a_power_cut_has_damaged_is_compiled_anew(tmp_path):
    assert _kernel(tmp_path)(1.5) == 3.0
    (index,) = (tmp_path / "__pycache__").glob("*.nbi")
    whole = index.read_bytes()
    for kept in (0, len(whole) // 2):
        index.write_bytes(whole[:kept])
        assert _kernel(tmp_path)(1.5) == 3.0
        assert len(index.read_bytes()) == len(whole)


def test_a_cache_on_a_full_disk_costs_the_cache_and_no_more(tmp_path, monkeypatch):
    def full(self, key, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)
    assert _kernel(tmp_path)(1.5) == 3.0
