"""The command ``explain``: which layer a failure belongs to."""

from mrta_falsify.verbs.explain.explaining import explain
from mrta_falsify.verbs.explain.removals import removal_text
from mrta_falsify.verbs.explain.telling import needs_sentences

__all__ = ["explain", "needs_sentences", "removal_text"]
