"""Types, protocols and plain machinery that every other floor stands on.

Nothing in this package knows a simulator, Scenic, or where files live.
"""
