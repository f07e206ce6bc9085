"""Check whether this machine can run the toolkit, and gets the same result twice."""

from __future__ import annotations

import ctypes.util
import importlib
import importlib.metadata
import importlib.util
import os
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mrta_falsify.core import registry
from mrta_falsify.core.config import default_engine
from mrta_falsify.core.errors import HarnessError, MrtaFalsifyError
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.program import Command
from mrta_falsify.process.supervisor import run_command

OLDEST, NEWEST = (3, 11), (3, 13)  # Pythons

State = Literal["ok", "missing", "failed"]

#: default engine -> its module, which is also its distribution
ENGINES = {"bullet": "pybullet", "mujoco": "mujoco"}
#: module to import -> distribution it comes in; what a default run needs
REQUIRED = {
    "click": "click",
    "cmaes": "cmaes",
    "daqp": "daqp",
    "fcl": "python-fcl",
    "imageio": "imageio",
    "jinja2": "jinja2",
    "matplotlib": "matplotlib",
    "msgpack": "msgpack",
    "numba": "numba",
    "numpy": "numpy",
    "ompl": "ompl",
    "optuna": "optuna",
    "ortools": "ortools",
    "osqp": "osqp",
    "pandas": "pandas",
    "PIL": "pillow",
    "rich": "rich",
    "scenic": "scenic",
    "scipy": "scipy",
    "sentil": "sentil",
    "shapely": "shapely",
    "trimesh": "trimesh",
    "yaml": "pyyaml",
}
#: extra -> the modules it brings
EXTRAS = {
    "bullet": ("pybullet",),
    "dask": ("distributed", "dask"),
    "mcap": ("mcap", "mcap_ros2", "rosbags"),
    "mujoco": ("mujoco",),
    "qd": ("ribs",),
    "ros": ("cyclonedds", "rosbags"),
    "verifai": ("verifai",),
    "video": ("imageio_ffmpeg",),
}
OPTIONAL = frozenset(module for modules in EXTRAS.values() for module in modules)
#: shared libraries that OpenCV (imported by Scenic) loads, with the Debian package
SYSTEM_LIBRARIES = {"GL": "libgl1", "glib-2.0": "libglib2.0-0", "gthread-2.0": "libglib2.0-0"}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")

_SELF_TEST = """
import dataclasses
import mrta_falsify as mf
world = dataclasses.replace(mf.find_world("aws_hospital_day", seed=1), horizon=10.0)
print("digest:", mf.run(world, keep_trace=False).trace.digest)
"""


@dataclass(frozen=True, slots=True)
class HealthCheck:
    """One finding; ``missing`` means something optional is absent."""

    name: str
    state: State
    detail: str


def doctor() -> tuple[HealthCheck, ...]:
    """Check this machine; each check is independent of the others."""
    checks = [_check_python(), _check_default_engine()]
    checks += [_check_module(module, name) for module, name in REQUIRED.items()]
    checks += [_check_extra(extra, modules) for extra, modules in EXTRAS.items()]
    checks += [_check_library(name, package) for name, package in SYSTEM_LIBRARIES.items()]
    checks += [_check_cache(), _check_plugins(), _check_browser(), _check_determinism()]
    return tuple(checks)


def is_healthy(checks: tuple[HealthCheck, ...]) -> bool:
    """Whether nothing that is needed has failed."""
    return all(check.state != "failed" for check in checks)


def _check_python() -> HealthCheck:
    found = ".".join(map(str, sys.version_info[:3]))
    if OLDEST <= sys.version_info[:2] <= NEWEST:
        return HealthCheck("python", "ok", found)
    return HealthCheck("python", "failed", f"{found}; install Python 3.11, 3.12 or 3.13")


def _check_default_engine() -> HealthCheck:
    """Say which engine judges here, and why."""
    name = default_engine()
    found = _check_module(ENGINES[name], ENGINES[name])
    why = "" if name == "bullet" else ", since PyBullet is not installed"
    detail = f"{name} ({ENGINES[name]} {found.detail}){why}"
    return HealthCheck("default engine", found.state, detail)


def _check_module(module: str, distribution: str) -> HealthCheck:
    try:
        importlib.import_module(module)
        return HealthCheck(distribution, "ok", importlib.metadata.version(distribution))
    except Exception as error:
        return HealthCheck(distribution, "failed", f"{type(error).__name__}: {error}")


def _check_extra(extra: str, modules: tuple[str, ...]) -> HealthCheck:
    name = f"extra {extra}"
    absent = [module for module in modules if not _is_installed(module)]
    if not absent:
        return HealthCheck(name, "ok", "installed")
    return HealthCheck(
        name,
        "missing",
        f"no {', '.join(absent)}; if you want it, in the checkout: pip install '.[{extra}]'",
    )


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ValueError:  # it is blocked
        return False


def _check_library(name: str, package: str) -> HealthCheck:
    found = ctypes.util.find_library(name)
    if found:
        return HealthCheck(f"lib{name}", "ok", found)
    try:
        importlib.import_module("cv2")
        return HealthCheck(f"lib{name}", "missing", "this OpenCV does without")
    except ImportError:
        detail = f"Scenic's OpenCV needs it: apt-get install {package}"
        return HealthCheck(f"lib{name}", "failed", detail)


def _check_cache() -> HealthCheck:
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parent)
    if os.access(folder, os.W_OK):
        return HealthCheck("numba cache", "ok", f"{folder} is writable")
    return HealthCheck(
        "numba cache",
        "missing",
        f"{folder} is not writable, so every process compiles anew; set NUMBA_CACHE_DIR",
    )


def _check_plugins() -> HealthCheck:
    """Load every registered component; one whose extra is not installed is only missing."""
    broken, without = [], []
    for point in registry.EXTENSION_POINTS:
        for name in registry.names(point):
            try:
                registry.load(point, name)
            except MrtaFalsifyError as error:
                absent = getattr(error.__cause__, "name", None) or ""
                if absent.partition(".")[0] in OPTIONAL:
                    without.append(f"{point} {name}")
                else:
                    broken.append(str(error))
    if broken:
        return HealthCheck("plug-ins", "failed", "; ".join(broken))
    detail = f" but {', '.join(without)}, which needs its extra" if without else ""
    return HealthCheck("plug-ins", "ok", f"every registered component can be loaded{detail}")


def _check_browser() -> HealthCheck:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found:
        return HealthCheck("chromium", "ok", found)
    return HealthCheck("chromium", "missing", "only the tests that open report pages need it")


def _failed_self_test(why: str) -> HealthCheck:
    return HealthCheck("determinism", "failed", f"the self-test did not run: {why}")


def _check_determinism() -> HealthCheck:
    """Run the same ten seconds in two processes with different hash seeds."""
    digests = []
    for hash_seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        command = Command([sys.executable, "-P", "-c", _SELF_TEST], environment)
        try:
            done = run_command(command, Budget())
        except HarnessError as error:
            return _failed_self_test(str(error))
        except Ending as error:
            return _failed_self_test(error.of("self-test"))
        lines = done.text.strip().splitlines() or ["no message"]
        if done.code != 0:
            return _failed_self_test(lines[-1])
        found = re.search("digest: ([0-9a-f]+)", done.text)  # stderr is in the text, too
        if found is None:
            return _failed_self_test("it printed no trace digest")
        digests.append(found[1])
    if digests[0] != digests[1]:
        return HealthCheck(
            "determinism", "failed", f"trace digests differ: {' and '.join(digests)}"
        )
    return HealthCheck("determinism", "ok", f"two processes, one trace digest {digests[0][:16]}")
