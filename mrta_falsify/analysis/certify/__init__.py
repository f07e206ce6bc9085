"""Certificates of deadlocks: found, and checked by a program of their own."""
