"""How one robot gets past the corridors, doors, lifts and chargers on its way."""

from __future__ import annotations

from typing import NamedTuple

from mrta_falsify.core.fleet import Phase


class Passage(NamedTuple):
    """What one robot waits for on its way; part of the stack's memory."""

    chain: tuple[int, ...] = ()  #: queues asked for together, the first one first
    spot: int | None = None  #: waiting spot of the first queue that it goes to
    standing: Phase | None = None  #: QUEUEING: stands before a resource; SERVING: stands in it
    asks_for_room: bool = False  #: asks for its room from before a corridor


CLEAR = Passage()  # waits for nothing
