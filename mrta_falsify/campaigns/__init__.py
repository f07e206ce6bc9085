"""Falsification campaigns: ask, run, store, tell; nothing here knows Scenic or a simulator."""
