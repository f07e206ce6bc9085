"""Layers that fail, as a user might write them; tests copy this file beside their worlds.

Each drives as the shipped layer until ``at`` [s] of simulated time, and then does its worst.
"""

from __future__ import annotations

import ctypes
import dataclasses
import os
import random
import signal
import sys
import time as clock
from dataclasses import dataclass

import numpy as np
from numba import njit

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.allocation.insertion import Insertion
from mrta_falsify.stack.control.cluster import ClusterCbf
from mrta_falsify.stack.planning.astar import AStar
from simulator_interface.engines.kinematic import KinematicEngine


class Failing(ClusterCbf):
    """Drives as the shipped controller until ``at``."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        at: float = 2.0  #: [s]

    def __init__(self, options: Options) -> None:
        super().__init__(ClusterCbf.Options())
        self.at = options.at

    def control(self, view: ControlView) -> ControlResult:
        if view.time < self.at - 1e-9:
            return super().control(view)
        return self.fail(view)

    def fail(self, view: ControlView) -> ControlResult:
        raise NotImplementedError

    def twisted(self, view: ControlView, twist) -> ControlResult:
        result = ClusterCbf.control(self, view)
        return dataclasses.replace(
            result, command=dataclasses.replace(result.command, twist=twist(result.command.twist))
        )


# --- crashes -------------------------------------------------------------------------------


class Raises(Failing):
    def fail(self, view):
        return {}["left"]


class Exits(Failing):
    def fail(self, view):
        sys.exit("done with it")


class EndsProcess(Failing):
    def fail(self, view):
        os._exit(7)


class Aborts(Failing):
    def fail(self, view):
        os.abort()


class Segfaults(Failing):
    def fail(self, view):
        ctypes.string_at(0)


class IsKilled(Failing):
    """As by the system when memory runs out."""

    def fail(self, view):
        os.kill(os.getpid(), signal.SIGKILL)


class RaisingAllocator(Insertion):
    def allocate(self, problem):
        raise RuntimeError("no plan, no mercy")


class RaisingPlanner(AStar):
    def plan(self, start, goal):
        raise ValueError(f"cannot think of a way from {start.tolist()}")


class Unbuildable(Failing):
    def __init__(self, options) -> None:
        raise OSError("the licence server is down")


class UnbuildableAllocator(Insertion):
    def __init__(self, options) -> None:
        raise OSError("the licence server is down")


# --- hangs ---------------------------------------------------------------------------------


class Loops(Failing):
    def fail(self, view):
        while True:
            pass


@njit(cache=False)
def spin(x):
    while x > 0.0:
        x = x + 1.0 if x < 1e9 else 1.0
    return x


class LoopsCompiled(Failing):
    """Holds Python's lock for ever."""

    def fail(self, view):
        return spin(1.0)


class Sleeps(Failing):
    def fail(self, view):
        while True:
            clock.sleep(3600.0)


class LoopsOnce(Failing):
    """Loops in the first run only, as what waits for another process may."""

    def fail(self, view):
        try:
            os.close(os.open("looped", os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return ClusterCbf.control(self, view)
        while True:
            pass


# --- memory --------------------------------------------------------------------------------


class Hoards(Failing):
    """Takes 64 MiB a tick, in steps."""

    def fail(self, view):
        self.hoard = [*getattr(self, "hoard", []), np.ones(8 * 2**20)]
        return ClusterCbf.control(self, view)


class HoardsAtOnce(Failing):
    """Never ends to take memory within one tick."""

    def fail(self, view):
        hoard = []
        while True:
            hoard.append(np.ones(2**20))


# --- answers -------------------------------------------------------------------------------


class AnswersNan(Failing):
    def fail(self, view):
        return self.twisted(view, lambda twist: twist * np.nan)


class AnswersForOne(Failing):
    def fail(self, view):
        return self.twisted(view, lambda twist: twist[:1])


class AnswersWords(Failing):
    def fail(self, view):
        return self.twisted(view, lambda twist: twist.astype(str))


# --- not repeatable ------------------------------------------------------------------------


def _nudged(view: ControlView, result: ControlResult, by: float) -> ControlResult:
    twist = result.command.twist * (1.0 + 1e-3 * by)
    return dataclasses.replace(result, command=dataclasses.replace(result.command, twist=twist))


class DrawsRandomly(Failing):
    def fail(self, view):
        return _nudged(view, ClusterCbf.control(self, view), random.random())


class DrawsFromNumpy(Failing):
    def fail(self, view):
        return _nudged(view, ClusterCbf.control(self, view), np.random.random())  # noqa: NPY002


class LooksAtTheClock(Failing):
    def fail(self, view):
        return _nudged(view, ClusterCbf.control(self, view), clock.time() % 60.0)


COUNT = [0]


class CountsElsewhere(Failing):
    """Remembers something that is no part of its state."""

    def fail(self, view):
        COUNT[0] += 1
        return _nudged(view, ClusterCbf.control(self, view), COUNT[0] % 7)


class Remembers(Failing):
    """Remembers something in its own state, as it may."""

    def fail(self, view):
        self.count = getattr(self, "count", 0) + 1
        return _nudged(view, ClusterCbf.control(self, view), self.count % 7)


class WritesIntoItsInput(Failing):
    def fail(self, view):
        view.pose[:] += 1.0
        return ClusterCbf.control(self, view)


# --- in some worlds only -------------------------------------------------------------------


class RaisesIfFast(Failing):
    def fail(self, view):
        if view.max_speed[0] > 0.5:
            raise ZeroDivisionError("too fast to think")
        return ClusterCbf.control(self, view)


class LoopsIfFast(Failing):
    def fail(self, view):
        if view.max_speed[0] > 0.5:
            return spin(1.0)
        return ClusterCbf.control(self, view)


# --- not the stack's failures --------------------------------------------------------------


class BrokenEngine(KinematicEngine):
    def step(self, command, human_velocity):
        raise RuntimeError("the engine has a fault")


class BrokenSpecification:
    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        pass

    def __init__(self, options) -> None:
        pass

    def start(self, world, dt) -> None:
        pass

    def update(self, frame) -> None:
        raise RuntimeError("the specification has a fault")

    def verdict(self):
        return None


class Refuses(Failing):
    def __init__(self, options) -> None:
        raise ConfigError("users_layers: no such model")
