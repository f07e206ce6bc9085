"""The rule behind a failure: a box over named dimensions in which runs fail alike."""
