"""The command ``explain``: which layer a failure belongs to, and when it was decided."""

from mrta_falsify.verbs.explain.explaining import MAX_RUNS, explain
from mrta_falsify.verbs.explain.removals import removal_text
from mrta_falsify.verbs.explain.rewinding import REWINDS
from mrta_falsify.verbs.explain.rows import NO_LAYER
from mrta_falsify.verbs.explain.sentences import decided_sentences, needs_sentences

__all__ = [
    "MAX_RUNS",
    "NO_LAYER",
    "REWINDS",
    "decided_sentences",
    "explain",
    "needs_sentences",
    "removal_text",
]
