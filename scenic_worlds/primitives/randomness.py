"""The door to the global random generators that Scenic draws from."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from mrta_falsify.core.seeding import stream


@contextmanager
def seeded(seed: int, purpose: str) -> Iterator[None]:
    """Seed Python's and numpy's global generators; leave them as they were found.

    Args:
        seed: of the candidate, >= 0.
        purpose: name of the random stream.
    """
    with seeded_by(stream(seed, purpose)):
        yield


@contextmanager
def seeded_by(numbers: np.random.Generator) -> Iterator[None]:
    """The same, with seeds drawn from ``numbers``."""
    before = GeneratorState()
    random.seed(int(numbers.integers(2**63)))
    np.random.seed(int(numbers.integers(2**32)))  # noqa: NPY002
    try:
        yield
    finally:
        before.restore()


class GeneratorState:
    """State of the global generators at one moment."""

    def __init__(self) -> None:
        self._python = random.getstate()
        self._numpy = np.random.get_state()  # noqa: NPY002

    def restore(self) -> None:
        """Go back to that moment."""
        random.setstate(self._python)
        np.random.set_state(self._numpy)  # noqa: NPY002

    def is_current(self) -> bool:
        """Whether the generators have not been drawn from since."""
        kind, keys, *rest = np.random.get_state()  # noqa: NPY002
        then_kind, then_keys, *then_rest = self._numpy
        return (
            random.getstate() == self._python
            and kind == then_kind
            and rest == then_rest
            and bool(np.array_equal(keys, then_keys))
        )
