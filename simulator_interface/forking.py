"""Asking a copy of this process: what would come of it?

A copy made by ``os.fork`` shares nothing with the original but its past, so an episode can be
tried out from any moment on, physics included, and is as it was afterwards.
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
    """Whether this system copies a process safely in mid-run."""
    return sys.platform == "linux"


def answer_of_a_copy(run: Callable[[], Any]) -> Any:
    """``run()`` in a copy of this process.

    Args:
        run: gives JSON-shaped data.

    Returns:
        What ``run`` gave.

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
