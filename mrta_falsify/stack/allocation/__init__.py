"""Allocators: which robot serves which task."""
