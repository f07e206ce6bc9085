"""Requirements of the author's, hard and soft, and lines of sight with things in between."""
floor = RectangularRegion((0, 0), 0, 12, 12)
workspace = Workspace(floor)

class Item(Object):
    position: (Range(-5.5, 5.5), Range(-5.5, 5.5), 0.5)
    width: 0.7
    length: 0.7

ego = new Item with name 'guard', with viewAngles (360 deg, 180 deg)
first = new Item with name 'first'
second = new Item with name 'second'
screen = new Item with width 2.5, with length 0.2, with occluding True, with name 'screen'
watched = new Item with name 'watched', with requireVisible True

require (distance from first to second) > 2
require first.position.x < second.position.x + 4 as 'left to right'
require[0.5] (distance from ego to screen) < 8
require[0.3] ego can see first
