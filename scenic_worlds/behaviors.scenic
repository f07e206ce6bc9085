"""Behaviours of people and scripted robots.

A *place* is a room by number or name, a point `(x, y)`, or an object. A speed of 0 is the
person's own. Times are in seconds of the episode.

    new Human at (4, 2), with behavior FollowRoute([(4, 11), (4, 2)], repeat=True)
    new Human at (4, 2), with behavior InTurn(WaitFor(5), Push(bed, (4, -3)), Leave())

A person whose behaviour is one of these gets it written into the world, which then runs
without this program. Behaviours of your own use them with `do`, `do ... until` and
`try: do ... interrupt when`. A person without an action stands still.
"""

from simulator_interface.scenic_bridge.actions import CarryOn, script


behavior WalkTo(place, speed=0):
    """Walk to a place, around whatever the map shows."""
    todo = script('WalkTo', place, speed=speed)
    while not todo.done:
        take CarryOn(todo)


behavior FollowRoute(route, repeat=False, speed=0):
    """Walk from place to place; with `repeat` until the episode ends."""
    todo = script('FollowRoute', route, repeat=repeat, speed=speed)
    while not todo.done:
        take CarryOn(todo)


behavior WaitFor(seconds):
    """Stand for a time."""
    todo = script('WaitFor', seconds)
    while not todo.done:
        take CarryOn(todo)


behavior WaitUntil(time):
    """Stand until a moment of the episode."""
    todo = script('WaitUntil', time)
    while not todo.done:
        take CarryOn(todo)


behavior StandStill():
    """Stand until the episode ends."""
    todo = script('StandStill')
    while not todo.done:
        take CarryOn(todo)


behavior Push(thing, place, speed=0, keeps=False):
    """Walk behind a piece of furniture and push it until its centre is at a place.

    Without progress for 20 s the piece is left where it is. Who `keeps` it brings it
    back to where it was, and does not begin where no way is as wide as the piece. The piece
    needs `with movable True` if the behaviour that pushes it is your own.
    """
    todo = script('Push', thing, place, speed=speed, keeps=keeps)
    while not todo.done:
        take CarryOn(todo)


behavior PushAlong(thing, route, pause=0, speed=0):
    """Push a piece of furniture from place to place, with a pause at each.

    On the way it is never left, as `Push` with `keeps` says.
    """
    todo = script('PushAlong', thing, route, pause=pause, speed=speed)
    while not todo.done:
        take CarryOn(todo)


behavior Appear(place):
    """Enter the building at a place; who has this as a first step is not there before."""
    todo = script('Appear', place)
    while not todo.done:
        take CarryOn(todo)


behavior Leave():
    """Leave the building, here and now."""
    todo = script('Leave')
    while not todo.done:
        take CarryOn(todo)


behavior InTurn(*steps):
    """Behaviours of this library one after the other, as one."""
    todo = script('InTurn', *steps)
    while not todo.done:
        take CarryOn(todo)
