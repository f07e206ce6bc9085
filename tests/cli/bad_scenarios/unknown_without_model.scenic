new Zeppelin at (1, 2)
param tasks = [(0, 0, 1, 200)]
