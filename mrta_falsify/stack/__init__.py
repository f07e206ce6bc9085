"""The robot stack: every layer from tasks to wheel commands; no simulator, no files."""
