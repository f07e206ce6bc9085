"""From a scene to a trace: worlds, costmaps, engines, the tick loop, and foreign formats."""
