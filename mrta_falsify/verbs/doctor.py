"""What ``doctor`` checks: whether this machine can run the toolkit, and run it the same twice."""

from __future__ import annotations

import ctypes.util
import importlib
import importlib.metadata
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mrta_falsify.core import codec, registry
from mrta_falsify.core.errors import MrtaFalsifyError

State = Literal["ok", "missing", "failed"]

#: module to import -> distribution it comes in; what a default run needs
REQUIRED = {
    "click": "click",
    "daqp": "daqp",
    "fcl": "python-fcl",
    "imageio": "imageio",
    "jinja2": "jinja2",
    "matplotlib": "matplotlib",
    "networkx": "networkx",
    "numba": "numba",
    "numpy": "numpy",
    "ompl": "ompl",
    "osqp": "osqp",
    "pandas": "pandas",
    "PIL": "pillow",
    "pybullet": "pybullet",
    "rich": "rich",
    "scenic": "scenic",
    "scipy": "scipy",
    "sentil": "sentil",
    "shapely": "shapely",
    "trimesh": "trimesh",
    "yaml": "pyyaml",
}
OPTIONAL = {"imageio_ffmpeg": "imageio-ffmpeg"}
#: shared libraries that OpenCV (imported by Scenic) loads, with the Debian package
SYSTEM_LIBRARIES = {"GL": "libgl1", "glib-2.0": "libglib2.0-0", "gthread-2.0": "libglib2.0-0"}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")

_SELF_TEST = """
import dataclasses
from mrta_falsify.verbs import run as app
world = app.find_world("aws_hospital_day", seed=1)
world = dataclasses.replace(world, horizon=10.0)
print(app.run(world, keep_trace=False).trace.digest)
"""


@dataclass(frozen=True, slots=True)
class Check:
    """One finding; ``missing`` means something optional is absent."""

    name: str
    state: State
    detail: str


def doctor() -> tuple[Check, ...]:
    """Every check of this machine, each independent of the others."""
    checks = [_check_python()]
    checks += [_check_module(module, name, optional=False) for module, name in REQUIRED.items()]
    checks += [_check_module(module, name, optional=True) for module, name in OPTIONAL.items()]
    checks += [_check_library(name, package) for name, package in SYSTEM_LIBRARIES.items()]
    checks += [_check_cache(), _check_plugins(), _check_browser(), _check_determinism()]
    return tuple(checks)


def is_healthy(checks: tuple[Check, ...]) -> bool:
    """Whether nothing that is needed has failed."""
    return all(check.state != "failed" for check in checks)


def as_rows(checks: tuple[Check, ...]) -> list[dict[str, Any]]:
    """Checks as JSON-shaped rows."""
    return [codec.encode(check) for check in checks]


def _check_python() -> Check:
    found = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] == (3, 11):
        return Check("python", "ok", found)
    return Check("python", "failed", f"{found}; PyBullet has wheels for 3.11 only (of what we use)")


def _check_module(module: str, distribution: str, *, optional: bool) -> Check:
    try:
        importlib.import_module(module)
        return Check(distribution, "ok", importlib.metadata.version(distribution))
    except Exception as error:
        state: State = "missing" if optional else "failed"
        return Check(distribution, state, f"{type(error).__name__}: {error}")


def _check_library(name: str, package: str) -> Check:
    found = ctypes.util.find_library(name)
    if found:
        return Check(f"lib{name}", "ok", found)
    return Check(f"lib{name}", "failed", f"Scenic's OpenCV needs it: apt-get install {package}")


def _check_cache() -> Check:
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parent)
    if os.access(folder, os.W_OK):
        return Check("numba cache", "ok", f"{folder} is writable")
    return Check(
        "numba cache",
        "missing",
        f"{folder} is not writable, so every process compiles anew; set NUMBA_CACHE_DIR",
    )


def _check_plugins() -> Check:
    broken = []
    for point in registry.EXTENSION_POINTS:
        for name in registry.names(point):
            try:
                registry.load(point, name)
            except MrtaFalsifyError as error:
                broken.append(str(error))
    if broken:
        return Check("plug-ins", "failed", "; ".join(broken))
    return Check("plug-ins", "ok", "every registered component can be loaded")


def _check_browser() -> Check:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found:
        return Check("chromium", "ok", found)
    return Check("chromium", "missing", "only the tests that open report pages need it")


def _check_determinism() -> Check:
    """The same ten seconds in two processes with different hash seeds."""
    digests = []
    for hash_seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        done = subprocess.run(
            [sys.executable, "-c", _SELF_TEST],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines() or ["no message"]
            return Check("determinism", "failed", f"the self-test did not run: {lines[-1]}")
        digests.append(done.stdout.strip().splitlines()[-1])
    if digests[0] != digests[1]:
        return Check("determinism", "failed", f"trace digests differ: {' and '.join(digests)}")
    return Check("determinism", "ok", f"two processes, one trace digest {digests[0][:16]}")
