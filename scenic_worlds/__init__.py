"""Scenic worlds: layouts, Scenic programs, and the Python that drives them."""
