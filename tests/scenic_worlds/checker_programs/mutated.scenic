"""Things moved by noise, in place and in heading."""
floor = RectangularRegion((0, 0), 0, 6.5, 6.5)
workspace = Workspace(floor)

for i in range(5):
    thing = new Object at (1.15 * (i - 2), Range(-1, 1), 0.5), with width 0.6, with length 0.9,
        with positionStdDev (0.24, 0.24, 0), with orientationStdDev (0.4, 0, 0)
    mutate thing
post = new Object at (0, 2.4, 0.5), with width 0.4, with length 0.4, with shape CylinderShape()
mutate post by 0.2
