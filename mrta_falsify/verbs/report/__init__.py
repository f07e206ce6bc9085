"""The report of a campaign, built from its store alone."""
