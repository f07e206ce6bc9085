"""Client libraries: one file each, to be copied beside a stack in its own process."""
