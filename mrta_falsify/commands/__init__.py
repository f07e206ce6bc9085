"""What each command does: read, call, return a value."""
