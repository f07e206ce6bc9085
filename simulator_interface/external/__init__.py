"""Stacks in processes of their own, asked in lock-step over a socket; see docs/door.md."""
