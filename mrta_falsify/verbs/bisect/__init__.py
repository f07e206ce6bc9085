"""Which commit of a stack's repository brought a failure."""
