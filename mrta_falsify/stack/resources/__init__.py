"""What robots use in turn: rooms, corridors, doors, lifts, chargers, parking."""
