"""Forks of this process, in which an episode can be continued and thrown away.

A copy made by ``os.fork`` shares nothing with the original but its past. So an episode can be
continued from any moment, physics included, and the original stays as it was.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any

from mrta_falsify.core.errors import HarnessError


def can_fork() -> bool:
    """Whether this system forks a process safely in mid-run."""
    return sys.platform == "linux"


def run_in_copy(run: Callable[[], Any]) -> Any:
    """Run something in a copy of this process.

    Args:
        run: returns JSON-shaped data.

    Returns:
        What ``run`` returned.

    Raises:
        HarnessError: the copy failed; with the last line of its traceback.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(reader)
            with os.fdopen(writer, "w") as pipe:
                try:
                    json.dump({"answer": run()}, pipe)
                except Exception:
                    json.dump({"error": traceback.format_exc()}, pipe)
            code = 0
        finally:
            os._exit(code)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    data = json.loads(text) if text else {"error": "the copy ended without an answer"}
    if "error" in data:
        raise HarnessError(f"a copy of the run failed: {data['error'].strip().splitlines()[-1]}")
    return data["answer"]
