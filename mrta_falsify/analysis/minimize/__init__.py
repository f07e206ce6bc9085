"""The command ``minimize``: the smallest world that still fails in the same way."""

from mrta_falsify.analysis.minimize.minimising import minimize

__all__ = ["minimize"]
