"""Runs and campaigns recorded by an earlier version; see ``record.py``."""
