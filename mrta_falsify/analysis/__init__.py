"""What follows from a failure: why it happens, what it needs, what proves it."""
