"""Policies: functions from what one robot sees to how it drives, from a file."""
