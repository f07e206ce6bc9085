"""``import LOG``: who waited for whom in a recorded run, and a scenario of its neighbourhood."""
