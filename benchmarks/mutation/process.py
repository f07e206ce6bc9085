"""A stack in a process of its own: asked by lines of JSON, ended when it takes too long."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks.mutation.runs import CRASH, HANG, Run
from benchmarks.mutation.trees import search_path
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError

COMPILING = 600.0  # s of wall clock for what a process compiles, which its CPU limit leaves out
WALL = 6.0  # times the CPU limit; others may use the cores, and forked runs are waited for
LOOK_EVERY = 0.25  # s between two looks at whether the benchmark was interrupted
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class StoppedError(Exception):
    """The benchmark was interrupted."""


class StackProcess:
    """A process that runs the stack of one tree; starts when it is asked, again after an end."""

    def __init__(self, directory: Path, tree: Path, *, is_watching: bool = False) -> None:
        """Keep what the process needs.

        Args:
            directory: of the trees.
            tree: whose stack is run.
            is_watching: the process knows which lines of the stack run.
        """
        self._directory, self._tree = directory, tree
        self._mode = ("watch",) if is_watching else ()
        self._process: subprocess.Popen[bytes] | None = None
        self._results = -1
        self.stopped = False  #: by another thread

    def __enter__(self) -> StackProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def run(
        self,
        world: dict[str, Any],
        stack: StackConfig,
        specifications: tuple[str, ...],
        *,
        cpu_s: float,
        lines: bool = False,
    ) -> Run:
        """Judge a world, JSON-shaped, under this stack.

        Args:
            world: as ``world.json`` has it.
            stack: its layers.
            specifications: that judge.
            cpu_s: after which it hangs [s], compiling apart.
            lines: also say which lines of the stack ran.
        """
        request = {"do": "run", "world": world, "stack": codec.encode(stack), "lines": lines}
        request["specifications"] = specifications
        return codec.decode(Run, self.ask(request, cpu_s=cpu_s), where="run")

    def ask(self, request: dict[str, Any], *, cpu_s: float) -> dict[str, Any]:
        """Send a request, and wait for its answer.

        Args:
            request: see :mod:`benchmarks.mutation.server`.
            cpu_s: CPU time after which the process is ended [s].

        Returns:
            The answer; ``fate`` is ``crash`` or ``hang`` for a process that has ended.

        Raises:
            StoppedError: the benchmark was interrupted.
        """
        if self._process is None:
            self._start()
        assert self._process is not None
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            data = json.dumps({**request, "cpu_s": cpu_s}).encode()
            self._process.stdin.write(data + b"\n")
            self._process.stdin.flush()
        return self._answer(time.monotonic() + WALL * cpu_s + COMPILING)

    def close(self) -> None:
        """End the process, and what it has forked."""
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        with contextlib.suppress(BrokenPipeError):
            if process.stdin is not None:
                process.stdin.close()
        os.close(self._results)

    def _start(self) -> None:
        read_end, write_end = os.pipe()
        environment = {**os.environ, **ONE_THREAD}
        environment["PYTHONPATH"] = search_path(self._directory, self._tree)
        environment.pop("NUMBA_CACHE_DIR", None)  # compiled code lies in the tree
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "benchmarks.mutation.server", str(write_end), *self._mode],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(write_end,),
            cwd=self._tree,
            env=environment,
            start_new_session=True,  # Ctrl-C is the benchmark's business
        )
        os.close(write_end)
        self._results = read_end

    def _answer(self, end: float) -> dict[str, Any]:
        buffer = bytearray()
        with selectors.DefaultSelector() as selector:
            selector.register(self._results, selectors.EVENT_READ)
            while not buffer.endswith(b"\n"):
                if self.stopped:
                    self.close()
                    raise StoppedError
                if time.monotonic() > end:
                    self.close()
                    return {"fate": HANG, "error": "no answer in time"}
                if not selector.select(LOOK_EVERY):
                    continue
                data = os.read(self._results, 1 << 20)
                if not data:
                    return self._ended()
                buffer += data
        answer: dict[str, Any] = json.loads(buffer)
        return answer

    def _ended(self) -> dict[str, Any]:
        assert self._process is not None
        code = self._process.wait()
        self.close()
        if code == -signal.SIGPROF:
            return {"fate": HANG, "error": "exceeded its CPU time"}
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return {"fate": CRASH, "error": f"the process ended by {how}"}


def expected(answer: dict[str, Any], what: str) -> dict[str, Any]:
    """Pass on an answer of the sound stack.

    Raises:
        HarnessError: its process crashed or hung: that is ours, not a mutant's.
    """
    if answer.get("fate") in (CRASH, HANG):
        raise HarnessError(f"the sound stack: {what}: {answer['fate']}: {answer['error']}")
    return answer
