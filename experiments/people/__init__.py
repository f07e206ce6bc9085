"""People beside published measurements."""
