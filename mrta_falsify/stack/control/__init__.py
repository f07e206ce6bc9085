"""Control: from look-ahead points to twists, by barrier programs alone or in clusters."""
