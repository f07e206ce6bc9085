"""The border to Scenic: scenes to worlds, and Scenic's simulator interface over a run."""
