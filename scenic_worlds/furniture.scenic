"""Furniture of hospitals, offices and warehouses, with the sizes of common products.

`width` is across the heading, `length` along it, all in metres; give others with `with`.
Furniture keeps clear of doorways, room points, waiting spots and parking (`standing_room`);
`with regionContainedIn free_floor` lifts that. `on REGION` puts the middle of the back edge
into the region, `in REGION` the centre.

Sizes: hospital bed IEC 60601-2-52 class (mattress 0.90 x 2.00 m, outside 1.0 x 2.2 m); bedside
cabinet 0.45 x 0.45 x 0.85 m; office desk EN 527-1 (1.6 x 0.8 x 0.74 m); chair EN 1335-1;
wheelchair within ISO 7176-5's 0.70 x 1.20 m; trolleys and lockers after suppliers' lists;
EUR pallet EN 13698-1 (0.8 x 1.2 x 0.144 m).
"""

from scenic_worlds.floor import FloorObject, places, standing_room
from scenic_worlds.random_places import region_to_stand_in

param clear_of_doors = False


class Furniture(FloorObject):
    """Something solid; its footprint is width x length.

    Properties:
        mesh: names a shape to draw it with (see simulator_interface/furniture_shapes.py);
            robots meet the extruded footprint.
        movable: may be pushed.
        clear_of_doors: stands off doorways by what a robot needs to pass; `param clear_of_doors`
            unless it is given.
    """
    kind: 'furniture'
    mesh: ''
    movable: False
    clear_of_doors: globalParameters.clear_of_doors
    regionContainedIn: region_to_stand_in(places, self.clear_of_doors)
    position: new Point in standing_room
    baseOffset: (0, -self.length / 2, 0)


# --- beside walls ----------------------------------------------------------------------------

class Bed(Furniture):
    """A hospital bed with rails; its head is at the back."""
    kind: 'bed'
    mesh: 'bed'
    width: 1.0
    length: 2.2
    height: 0.95


class BedsideCabinet(Furniture):
    kind: 'bedside_cabinet'
    mesh: 'cabinet'
    width: 0.45
    length: 0.45
    height: 0.85


class Bookshelf(Furniture):
    """A bookshelf of 0.9 x 0.3 m, as high as a room allows."""
    kind: 'bookshelf'
    mesh: 'bookshelf'
    width: 0.9
    length: 0.3
    height: 1.9


class Cabinet(Furniture):
    kind: 'cabinet'
    mesh: 'cabinet'
    width: 0.8
    length: 0.45
    height: 1.2


class Locker(Furniture):
    kind: 'locker'
    mesh: 'cabinet'
    width: 0.9
    length: 0.5
    height: 1.8


class Desk(Furniture):
    kind: 'desk'
    mesh: 'desk'
    width: 1.6
    length: 0.8
    height: 0.74


class Table(Furniture):
    kind: 'table'
    mesh: 'desk'
    width: 1.2
    length: 0.8
    height: 0.74


class Bench(Furniture):
    """A row of three waiting seats."""
    kind: 'bench'
    mesh: 'bench'
    width: 1.6
    length: 0.6
    height: 0.8


class Sofa(Furniture):
    kind: 'sofa'
    mesh: 'sofa'
    width: 1.8
    length: 0.85
    height: 0.8


class VendingMachine(Furniture):
    kind: 'vending_machine'
    mesh: 'box'
    width: 0.95
    length: 0.8
    height: 1.83


class Curtain(Furniture):
    """A drawn privacy curtain or a folding screen on feet."""
    kind: 'curtain'
    mesh: 'curtain'
    width: 1.8
    length: 0.15
    height: 1.9


# --- moved about -----------------------------------------------------------------------------

class Chair(Furniture):
    kind: 'chair'
    mesh: 'chair'
    width: 0.5
    length: 0.55
    height: 0.85


class Stool(Furniture):
    kind: 'stool'
    mesh: 'stool'
    width: 0.4
    length: 0.4
    height: 0.55


class Trolley(Furniture):
    """A medication or linen trolley."""
    kind: 'trolley'
    mesh: 'trolley'
    width: 0.6
    length: 0.9
    height: 1.0


class Stretcher(Furniture):
    """A patient transport stretcher."""
    kind: 'stretcher'
    mesh: 'bed'
    width: 0.75
    length: 2.05
    height: 0.9


class Wheelchair(Furniture):
    kind: 'wheelchair'
    mesh: 'wheelchair'
    width: 0.66
    length: 1.06
    height: 0.92


class IVStand(Furniture):
    """An infusion stand on five castors."""
    kind: 'iv_stand'
    mesh: 'iv_stand'
    width: 0.55
    length: 0.55
    height: 1.9


class TrashBin(Furniture):
    kind: 'trash_bin'
    mesh: 'bin'
    width: 0.4
    length: 0.4
    height: 0.65


# --- warehouses ------------------------------------------------------------------------------

class Pallet(Furniture):
    """A loaded EUR pallet."""
    kind: 'pallet'
    mesh: 'pallet'
    width: 0.8
    length: 1.2
    height: 1.1


class Crate(Furniture):
    kind: 'crate'
    mesh: 'box'
    width: 0.6
    length: 0.4
    height: 0.45
