"""Child processes: started, watched, limited and ended in one place."""
