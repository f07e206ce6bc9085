"""People: how they find their way, carry out scripts and push furniture."""
