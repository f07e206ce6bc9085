"""Rooms that differ from sample to sample; things that may overlap or stand anywhere."""
import shapely
from scenic.core.distributions import distributionFunction
from scenic.core.regions import PolygonalRegion, Region

@distributionFunction
def hall(width, depth) -> Region:
    outline = shapely.box(-width / 2, -depth / 2, width / 2, depth / 2)
    niche = shapely.box(0, 0, width, 1.2)
    return PolygonalRegion(polygon=outline.union(niche))

width, depth = Range(6, 11), Range(4, 8)
param width = width
param depth = depth
room = hall(width, depth)
workspace = Workspace(everywhere)

class Item(Object):
    regionContainedIn: room
    position: (Range(-3, 3), Range(-2, 2), 0.5)
    yaw: Range(0, 360) deg

new Item with width 0.6, with length 0.6
new Item with width 0.6, with length 1.1, with allowCollisions Uniform(True, False)
new Item with width 0.8, with length 0.8, with regionContainedIn everywhere
new Item with width 0.7, with length 0.7, with allowCollisions True
new Item with width 0.5, with length 0.5,
    with regionContainedIn Uniform(room, CircularRegion((1, 0), 2.5), everywhere)
