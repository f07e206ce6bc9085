"""Boxes that lean and lie over, beside boxes that stand."""
floor = RectangularRegion((0, 0), 0, 8, 8)
workspace = Workspace(floor)

class Plank(Object):
    position: (Range(-3.5, 3.5), Range(-3.5, 3.5), 0.6)
    yaw: Range(0, 360) deg
    pitch: Range(-50, 50) deg
    roll: Uniform(0, 0, 30) * 1 deg
    width: 0.3
    length: 1.8
    height: 0.4

for i in range(3):
    new Plank
new Object at (Range(-3.5, 3.5), Range(-3.5, 3.5), 0.5), with width 0.9, with length 0.9
new Object at (Range(-3.5, 3.5), Range(-3.5, 3.5), 0.5), with width 0.9, with length 0.9,
    facing (Range(0, 360) deg, Uniform(0, 0.2), 0)
