"""The command ``family``: the rule behind a failure."""

from mrta_falsify.verbs.family.finding import find_family

__all__ = ["find_family"]
