"""One of every random primitive, for the distribution benchmark."""
from scenic_worlds.floors import hospital
import trimesh
param layout = hospital(rooms=4, station=False)
model scenic_worlds.model

new Robot with start_room DiscreteRange(0, 3), with max_speed TruncatedNormal(1, 0.5, 0.6, 1.4)

class Thing(FloorObject):
    kind: 'thing'
    allowCollisions: True
    regionContainedIn: everywhere

yard = RectangularRegion((0, 0), 30 deg, 6, 3)
disc = CircularRegion((2, 1), 2.5)
table = trimesh.creation.cylinder(radius=1.0, height=2.0, sections=12)
new Thing in yard
new Thing in disc
new Thing in SectorRegion(0 @ 0, 4, 20 deg, 70 deg)
new Thing in corridors
new Thing in standing_room
new Thing in yard.union(disc)
new Thing in disc.difference(yard)
new Thing in disc.intersect(yard)
new Thing in CircularRegion((0, 0), Range(1, 3))
new Thing in room(DiscreteRange(0, 3))
new Thing on route(0, 2)
new Thing on PolylineRegion([(0, 0), (3, 1), (3, 6), (-2, 6)])
new Thing in PointSetRegion('spots', [(0, 0), (1, 0), (2, 3), (4, 4), (5, 1)])
new Thing in BoxRegion(dimensions=(1, 2, 3), position=(1, 2, 3))
new Thing in MeshVolumeRegion(table)
new Thing at Uniform((0, 0), (1, 1), (2, 2)), facing Normal(0, 20) deg
new Thing with weight Discrete({1: 3, 2: 1, 3: 6})
new Thing at (Range(0, Range(1, 2)), Normal(Range(0, 3), 1))

param tasks = poisson(1 / 40, between=(0, 300), most=5)
