"""Tests; see README.md."""

import os

# One thread of linear algebra, as workers of a campaign have it; numpy reads this as it is loaded.
# The matrices are small: more threads spend twenty times the CPU time on waiting for each other.
for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
