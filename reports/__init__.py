"""Reports of runs and campaigns: one HTML page, pictures, animations, Markdown and JUnit.

The package turns values of the core into files that people read. It simulates nothing.
"""
