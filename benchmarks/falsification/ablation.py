"""What ``auto`` is without one of its parts, as samplers of a comparison: which part buys what?

A search stops at its first failure, so what ``auto`` does once a failure is known is no part here.
Which kinds of failure come first is none either: a pair of the suite says what counts (``then``).
"""

from __future__ import annotations

from mrta_falsify.core.config import Choice

PARTS = {
    "auto_without_loads": Choice("auto", {"loads": False}),
    "auto_without_kin": Choice("auto", {"kin": False}),
    "auto_without_rehearsals": Choice("auto", {"rehearse": False}),
    "auto_without_weighing": Choice("auto", {"weigh": False}),
    "auto_without_edges": Choice("auto", {"edges": False}),
}
