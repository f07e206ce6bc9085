"""Named random streams.

Every random number of a trial comes from ``stream(seed, name)``. So a layer that draws more
numbers never shifts another layer's numbers, and nothing depends on call order or ``hash()``.
"""

from __future__ import annotations

import hashlib

import numpy as np


def stream(seed: int, name: str) -> np.random.Generator:
    """Make an independent generator for one purpose.

    Args:
        seed: seed of the trial, >= 0.
        name: purpose, for example ``"start_offsets"`` or ``"wheel_slip/robot3"``.

    Returns:
        A PCG64 generator that depends on ``seed`` and ``name`` only.
    """
    digest = hashlib.sha256(name.encode()).digest()
    key = [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4)]
    return np.random.default_rng(np.random.SeedSequence([seed, *key]))


def candidate_seed(campaign_seed: int, number: int) -> int:
    """Derive the seed of one candidate; 63 bits, stable across processes and machines."""
    words = np.random.SeedSequence([campaign_seed, number]).generate_state(2, np.uint32)
    return (int(words[0]) << 31) ^ int(words[1])
