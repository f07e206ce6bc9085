"""A process that runs the stack of one tree: ``python -m benchmarks.mutation.server FD [watch]``.

It answers one JSON line for each on stdin, and ends when stdin closes. The time limit of a request
is CPU time without compiling: a process that exceeds it is ended by a signal, in compiled code too.
Forks count, those of forecasts and of ticks that are asked again.
With ``watch`` it knows which lines of the stack run.
"""

from __future__ import annotations

import importlib
import json
import mmap
import os
import resource
import signal
import struct
import sys
import traceback
from pathlib import Path
from typing import Any

from numba.core import event

from benchmarks.mutation.layers import stack_files
from benchmarks.mutation.lines import LineWatch

MEMORY = 6 << 30  # bytes of data; a mutant that gathers without end must not fill the machine
SECONDS = struct.Struct("=d")
AT_ONCE = 1e-6  # s, the shortest time that sets a timer; 0 would stop it
#: where requests are answered; imported at the first one, since a mutant may fail on import
ANSWERS = {
    "run": "benchmarks.mutation.judging",
    "explain": "benchmarks.mutation.judging",
    "cube": "benchmarks.mutation.programs",
    "realise": "benchmarks.mutation.programs",
    "rehearse": "benchmarks.mutation.programs",
}


def _cpu_s() -> float:
    """CPU time of this process and of what it has forked and waited for [s]."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


class CpuLimit(event.Listener):
    """Ends this process after some CPU time, that of its forks included.

    Compiling stops the clock, and is measured. A fork has what was left when it was made.
    """

    def __init__(self) -> None:
        self._shared = mmap.mmap(-1, SECONDS.size)  # s of compiling, forks included
        self._depth, self._left = 0, 0.0
        self._seconds, self._began, self._compiled = 0.0, 0.0, 0.0
        self._compiling_since = 0.0
        os.register_at_fork(before=self._arm, after_in_child=self._begin_in_fork)

    @property
    def compile_s(self) -> float:
        """CPU time of compiling since the last limit was set [s]."""
        return float(SECONDS.unpack_from(self._shared)[0]) - self._compiled

    def set(self, seconds: float) -> None:
        """Allow so much CPU time [s] from now on; 0: without end."""
        SECONDS.pack_into(self._shared, 0, 0.0)
        self._begin(seconds)

    def _begin(self, seconds: float) -> None:
        self._seconds, self._began, self._compiled = seconds, _cpu_s(), 0.0
        self._compiled = self.compile_s
        self._arm()

    def _begin_in_fork(self) -> None:
        self._begin(self._left)

    def _arm(self) -> None:
        """Set the timer to what is left; it alone does not see what forks have spent."""
        if self._depth > 0:
            return
        spent = _cpu_s() - self._began - self.compile_s
        self._left = max(self._seconds - spent, AT_ONCE) if self._seconds else 0.0
        signal.setitimer(signal.ITIMER_PROF, self._left)

    def on_start(self, event: event.Event) -> None:
        """Stop the clock."""
        self._depth += 1
        if self._depth == 1:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            self._compiling_since = _cpu_s()

    def on_end(self, event: event.Event) -> None:
        """Let the clock go on."""
        self._depth -= 1
        if self._depth == 0:
            total = SECONDS.unpack_from(self._shared)[0] + _cpu_s() - self._compiling_since
            SECONDS.pack_into(self._shared, 0, total)
            self._arm()


def answer_to(request: dict[str, Any], limit: CpuLimit, watch: LineWatch | None) -> dict[str, Any]:
    """Answer one request; what the stack raises is an answer, too."""
    if watch is not None:
        watch.clear()
    limit.set(request["cpu_s"])
    began = _cpu_s()
    try:
        answers = importlib.import_module(ANSWERS[request["do"]])
        answer: dict[str, Any] = getattr(answers, request["do"])(request)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        answer = {"fate": "crash", "error": f"{type(error).__name__}: {error} ({place})"[:300]}
    spent, compile_s = _cpu_s() - began, limit.compile_s
    limit.set(0.0)
    if request["do"] == "run":
        answer |= {"compile_s": compile_s, "cpu_s": spent - compile_s}
        if request["lines"] and watch is not None:
            answer["lines"] = watch.lines()
    return answer


def serve(results: int, *, is_watching: bool) -> None:
    """Answer requests until stdin closes."""
    limit, watch = CpuLimit(), None
    if is_watching:
        tree = Path.cwd()
        watch = LineWatch(tree, stack_files(tree))
        watch.install()
    event.register("numba:compile", limit)  # type: ignore[no-untyped-call]
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    with os.fdopen(results, "w") as replies:
        for line in sys.stdin:
            json.dump(answer_to(json.loads(line), limit, watch), replies)
            replies.write("\n")
            replies.flush()


if __name__ == "__main__":
    serve(int(sys.argv[1]), is_watching="watch" in sys.argv)
