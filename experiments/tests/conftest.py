"""Fixtures that tests of experiments share with those of the product."""

from tests.conftest import hall

__all__ = ["hall"]
