"""The smallest world that still fails in the same way."""
