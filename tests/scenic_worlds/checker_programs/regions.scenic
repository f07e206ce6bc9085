"""Containers of other kinds: discs, sectors, intersections, differences, volumes."""
disc = CircularRegion((0, 0), 4)
sector = SectorRegion(0 @ 0, 4.5, 0, 200 deg)
overlap = disc.intersect(RectangularRegion((2, 0), 0.3, 5, 5))
ring = disc.difference(CircularRegion((0, 0), 1.2))
workspace = Workspace(everywhere)

class Item(Object):
    yaw: Range(0, 360) deg
    width: 0.35
    length: 0.35
    height: 0.5

new Item in disc, with regionContainedIn disc
new Item at (Range(-1, 1.5), Range(0.3, 3), 0.3), with regionContainedIn sector
new Item in overlap, with regionContainedIn overlap
new Item in ring, with regionContainedIn ring
new Item at (Range(-1.9, 1.9), Range(-1.9, 1.9), 0.4), with shape ConeShape(), with height 0.4,
    with regionContainedIn BoxRegion(dimensions=(4.5, 4.5, 2))
