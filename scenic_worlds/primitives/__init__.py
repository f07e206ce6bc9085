"""Every random primitive of a Scenic program, driven from the unit cube.

``polygons`` and ``charts`` map the unit cube onto regions. ``leaves`` replaces Scenic's random
primitives with inverse maps; ``naming`` finds and names them. ``driver`` holds the search space
and evaluates a program at a point of it.
"""
