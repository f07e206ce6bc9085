"""Boxes of random heading in an L-shaped ward with a hole (a column) in it."""
import shapely

outline = shapely.Polygon([(0, 0), (9, 0), (9, 4), (4, 4), (4, 9), (0, 9)])
column = shapely.Polygon([(1.5, 1.5), (2.1, 1.5), (2.1, 2.1), (1.5, 2.1)])
ward = PolygonalRegion(polygon=outline.difference(column), name='ward')
workspace = Workspace(everywhere)

class Item(Object):
    regionContainedIn: ward
    position: new Point in ward
    yaw: Range(0, 360) deg
    height: 1.0

for i in range(3):
    new Item with width 0.5, with length 0.9, with name f'bed_{i + 1}'
new Item with width Range(0.2, 0.8), with length 0.3
