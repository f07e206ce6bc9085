"""Cylinders, cones, spheroids, and a mesh that is not convex, at several heights."""
import trimesh

# An L of two boxes: boxes fit into its corner without touching it.
corner = trimesh.creation.extrude_polygon(
    __import__('shapely').Polygon([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]), 1.0
)
floor = RectangularRegion((0, 0), 0, 12, 12)
workspace = Workspace(floor)

class Item(Object):
    position: (Range(-4.2, 4.2), Range(-4.2, 4.2), 0.5)
    yaw: Range(0, 360) deg

new Item with shape CylinderShape(), with width 1.2, with length 0.8, with name 'bin'
new Item with shape ConeShape(), with width 1.4, with length 1.4, with height 1.2
new Item with shape SpheroidShape(), with width 0.9, with length 1.5
new Item with shape MeshShape(corner), with width 2, with length 2, with height 1, with name 'counter'
new Item with width 0.8, with length 0.8, with name 'crate'
new Item at (Range(-4.2, 4.2), Range(-4.2, 4.2), 1.3), with width 1, with length 1
