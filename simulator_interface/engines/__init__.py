"""Engines: physics and its quick stand-in, with the sensors and bodies they share."""
