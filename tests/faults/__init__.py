"""Faults made by hand, and a command that shows that the tests catch each of them."""
