"""The command ``explain``: which layer a failure belongs to."""

from mrta_falsify.verbs.explain.explaining import explain
from mrta_falsify.verbs.explain.removals import removal_text

__all__ = ["explain", "removal_text"]
