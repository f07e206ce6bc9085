"""Boxes on a grid of half metres: edges touch exactly, and touch the border of their room."""
room = RectangularRegion((0, 0), 0, 5.5, 5.5)
workspace = Workspace(room)

class Block(Object):
    position: (0.5 * DiscreteRange(-5, 5), 0.5 * DiscreteRange(-5, 5), 0.5)
    yaw: Uniform(0, 90, 180, 270) * 1 deg
    width: 0.5
    length: Uniform(0.5, 0.5, 1)
    height: 1

for i in range(2):
    new Block
anchor = new Object at (0, 0, 0.5), with width 0.5, with length 0.5
new Object left of anchor by Uniform(0, 0.01, 0.25)
