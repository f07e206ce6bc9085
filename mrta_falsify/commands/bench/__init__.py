"""How fast every layer is on this machine."""
