new Object at (0, 0)
param tasks = [(0, 0, 1, 200)]
