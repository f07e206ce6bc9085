"""Put faults into a copy of the code, one at a time, and see whether the tests notice.

    python -m tests.faults.run [--only NAME ...]

The tree itself is never changed: its files are linked into a temporary folder, and there a faulty
file takes the place of a link. First the named tests run without a fault and must pass.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from tests.faults.table import Fault, read_faults

HERE = Path(__file__).resolve().parents[2]
OPTIONS = ("-x", "-q", "-rfE", "-p", "no:randomly", "-p", "no:cacheprovider")
FAILED_TEST = re.compile(r"^(?:FAILED|ERROR) (\S+::\S+)", re.MULTILINE)
MAKE_METADATA = "from setuptools import setup; setup()"  # names the components of this tree


def main() -> int:
    """Run the command; 0 if all faults are caught, 1 if one is not, 2 if none could be tried."""
    options = _options()
    faults = read_faults()
    unknown = set(options.only) - {fault.name for fault in faults}
    if unknown:
        print(f"no such fault: {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    chosen = [fault for fault in faults if not options.only or fault.name in options.only]
    with tempfile.TemporaryDirectory(prefix="faults-") as made:
        copy = options.keep or Path(made) / "tree"
        _fill_copy(options.tree, copy)
        if not options.skip_check and not _sound(chosen, copy):
            return 2
        caught = sum(_is_caught(fault, copy) for fault in chosen)
    print(f"{caught} of {len(chosen)} faults caught")
    return 0 if caught == len(chosen) else 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.faults.run", description=__doc__)
    parser.add_argument("--tree", type=Path, default=HERE, help="work tree to copy (default: this)")
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="copy to DIR and leave it there")
    parser.add_argument("--skip-check", action="store_true", help="run no test without a fault")
    return parser.parse_args()


def _fill_copy(tree: Path, copy: Path) -> None:
    """Link the files of ``tree`` that git knows or would take into ``copy``."""
    command = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    listed = subprocess.run(command, cwd=tree, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if (tree / name).is_file():
            _link(tree / name, copy / name)
    make = (sys.executable, "-W", "ignore", "-c", MAKE_METADATA, "-q", "egg_info")
    subprocess.run(make, cwd=copy, check=True, capture_output=True)


def _link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    try:
        target.hardlink_to(source)
    except OSError:  # another file system
        shutil.copy2(source, target)


def _sound(faults: Iterable[Fault], copy: Path) -> bool:
    """Whether each fault has its place, and the tests pass without any."""
    for fault in faults:
        if fault.count(copy) != 1:
            print(f"{fault.file}: {fault.find!r} occurs {fault.count(copy)} times, not once")
            return False
    tests = list(dict.fromkeys(test for fault in faults for test in fault.tests))
    code, output = _run_tests(tests, copy)
    if code != 0:
        print(f"the tests fail without a fault:\n{output}")
    return code == 0


def _is_caught(fault: Fault, copy: Path) -> bool:
    begun = time.monotonic()
    path = copy / fault.file
    faulty, kept = fault.text(copy), path.with_name(path.name + ".sound")
    path.rename(kept)  # keeps the time stamp, which caches of compiled code go by
    try:
        path.write_text(faulty, encoding="utf-8")
        code, output = _run_with_fault(fault, faulty, copy)
    finally:
        path.unlink()
        kept.rename(path)
    noticed = FAILED_TEST.search(output)
    spent = time.monotonic() - begun
    if code == 1 and noticed:
        print(f"caught      {fault.name}  ({spent:.0f} s, {noticed[1]})", flush=True)
        return True
    why = "" if code == 0 else f", pytest ended with {code}:\n{output}"
    print(f"NOT caught  {fault.name}  ({spent:.0f} s{why})", flush=True)
    return False


def _run_with_fault(fault: Fault, faulty: str, copy: Path) -> tuple[int, str]:
    """Run the tests of a fault; compile anew where compiled callers would keep the sound code."""
    if "njit" not in faulty:
        return _run_tests(fault.tests, copy)
    with tempfile.TemporaryDirectory(prefix="compiled-") as cache:
        return _run_tests(fault.tests, copy, NUMBA_CACHE_DIR=cache)


def _run_tests(tests: Iterable[str], copy: Path, **environment: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "pytest", *OPTIONS, "-m", "not long", *tests]
    run = subprocess.run(
        command,
        check=False,
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), **environment},
        capture_output=True,
        text=True,
    )
    return run.returncode, run.stdout + run.stderr


if __name__ == "__main__":
    sys.exit(main())
