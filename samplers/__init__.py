"""Samplers in the unit cube, one a file; they know no Scenic, no simulator and no store."""
