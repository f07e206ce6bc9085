"""The command ``explain``: which layer a failure belongs to, and when it was decided."""

from mrta_falsify.analysis.explain.explaining import MAX_RUNS, explain
from mrta_falsify.analysis.explain.removals import removal_text
from mrta_falsify.analysis.explain.rewinding import REWINDS
from mrta_falsify.analysis.explain.rows import NO_LAYER
from mrta_falsify.analysis.explain.sentences import decided_sentences, needs_sentences

__all__ = [
    "MAX_RUNS",
    "NO_LAYER",
    "REWINDS",
    "decided_sentences",
    "explain",
    "needs_sentences",
    "removal_text",
]
