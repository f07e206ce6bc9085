"""What became of garbled messages: outcomes counted, and defects in words."""

from __future__ import annotations

import contextlib
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from mrta_falsify.core.errors import InputError
from simulator_interface.external.answers import Wrong
from simulator_interface.external.wire import Closed, Late, Unreadable
from tests.external.garbled.garbling import Garbled

LONGEST = 600  # characters of a sentence
SLOWEST = 5.0  # s of CPU for one message


@dataclass
class Tally:
    """What became of garbled messages."""

    messages: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    defects: list[str] = field(default_factory=list)

    def take(self, made: Garbled, run: Callable[[], str]) -> None:
        """Count a message; ``run`` gives what came of it, and raises only what it expects."""
        self.messages += 1
        began = time.process_time()
        try:
            outcome = run()
        except (InputError, Wrong, Unreadable) as error:
            outcome = "refused"
            wrong = no_sentence(str(error))
            if wrong:
                self.note(made, f"{type(error).__name__}: {wrong}: {str(error)[:200]!r}")
        except Closed:
            outcome = "connection closed"
        except Late:
            outcome = "late"
        except Exception:
            outcome = "DEFECT"
            self.note(made, traceback.format_exc()[-700:])
        if time.process_time() - began > SLOWEST:
            self.note(made, f"took {time.process_time() - began:.1f} s of CPU")
        self.outcomes[outcome] += 1

    def note(self, made: Garbled, text: str) -> None:
        self.defects.append(f"{made.how} ({made.body[:120]!r}): {text}")


def no_sentence(text: str) -> str:
    """Say why ``text`` is no sentence for a user; empty: it is one."""
    if not text.strip():
        return "is empty"
    if len(text) > LONGEST:
        return f"has {len(text)} characters"
    if "\n" in text.strip() or "Traceback" in text:
        return "has several lines"
    with contextlib.suppress(UnicodeEncodeError):
        text.encode()
        return ""
    return "cannot be written"
