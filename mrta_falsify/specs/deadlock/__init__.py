"""The deadlock oracle: who blocks whom, who is stuck for good, and on whose account."""
