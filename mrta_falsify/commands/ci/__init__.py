"""What changed since the last run of a project: new, resolved, ongoing and flaky failures."""
