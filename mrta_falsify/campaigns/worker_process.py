"""A worker process: ``python -m mrta_falsify.campaigns.worker_process FD PARENT STDERR``.

Reads the campaign's settings, then jobs, one JSON line each, from stdin, and writes answers to
the file descriptor ``FD``. It ends when stdin closes, or when the parent is gone.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from typing import Any

from mrta_falsify.campaigns import time_limit
from mrta_falsify.campaigns.executors import open_target
from mrta_falsify.campaigns.settings import CampaignSettings
from mrta_falsify.core import codec
from mrta_falsify.core.durable import place_error_in
from mrta_falsify.core.errors import InputError, PlaceError
from mrta_falsify.core.garbage import collect_seldom

STDERR = 2  # file descriptor
ORPHAN_CHECK = 0.5  # s between two looks at who the parent is


def _end_with(parent: int) -> None:
    """Start a daemon thread that ends this process when its parent has ended, even in mid-trial."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(ORPHAN_CHECK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def serve(results: int, said: int) -> None:
    """Answer jobs until stdin closes.

    Args:
        results: file descriptor for answers.
        said: file descriptor of the parent's stderr, which becomes ours once this one is ready.
    """

    def answer(message: dict[str, Any]) -> None:
        data = json.dumps(message).encode() + b"\n"
        while data:
            data = data[os.write(results, data) :]

    try:
        settings = codec.decode(CampaignSettings, json.loads(sys.stdin.readline()), where="worker")
        trial = open_target(settings)
    except InputError as error:
        answer({"refused": str(error)})
        return
    except PlaceError as error:
        answer({"unwritable": str(error)})
        return
    answer({"ready": True})
    os.dup2(said, STDERR)  # until here the parent has kept what was said
    os.close(said)
    time_limit.tell_to(lambda: answer({"limit": "anew"}))
    for line in sys.stdin:
        job = json.loads(line)
        try:
            answer({"number": job["number"], "record": trial(job)})
        except InputError as error:
            answer({"number": job["number"], "refused": str(error)})
        except Exception as error:
            if place := place_error_in(error):
                answer({"number": job["number"], "unwritable": str(place)})
            else:
                answer({"number": job["number"], "crashed": traceback.format_exc()})


if __name__ == "__main__":
    _end_with(int(sys.argv[2]))
    collect_seldom()
    serve(int(sys.argv[1]), int(sys.argv[3]))
