"""Stacks of others: what they speak, and what takes the place of their middleware."""
