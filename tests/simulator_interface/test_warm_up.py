"""What a fork need not load again."""

from __future__ import annotations

from mrta_falsify.core import compiled
from mrta_falsify.process.supervisor import run_supervised
from simulator_interface.warm_up import warm_up


def test_a_fork_reads_no_compiled_function_that_was_read_before(monkeypatch):
    read = []

    def load(cache, signature, context, really=compiled._load):
        read.append(signature)
        return really(cache, signature, context)

    def functions_read() -> int:
        read.clear()
        warm_up.__wrapped__()
        return len(read)

    monkeypatch.setattr(compiled, "_load", load)
    warm_up()
    assert run_supervised(functions_read) == 0
