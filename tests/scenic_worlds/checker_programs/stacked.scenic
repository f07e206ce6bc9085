"""Things on, above and under other things; some touch exactly."""
floor = RectangularRegion((0, 0), 0, 7, 7)
workspace = Workspace(floor)

table = new Object at (Range(-3, 3), Range(-3, 3), 0.4),
    with width 1.6, with length 1, with height 0.8, with name 'table'
new Object at (table.position.x, table.position.y, 0.8 + Uniform(0.15, 0.1499, 0.1501, 0.16, 0.18, 0.2)),
    with width 0.4, with length 0.3, with height 0.3, with name 'lamp'
new Object at (Range(-3, 3), Range(-3, 3), Uniform(0.2, 0.9, 1.0, 1.2)),
    with width 1.2, with length 1.2, with height 0.4, with name 'shelf'
new Object at (Range(-3, 3), Range(-3, 3), 1.5), with shape SpheroidShape(), with name 'light'
new Object at (Range(-3, 3), Range(-3, 3), 0.2), with width 2, with length 0.5, with height 0.4
