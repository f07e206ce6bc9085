"""A controller that asks a policy: one function for all robots, each by what it sees itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.policy.observation import ACTIONS, observe, twists_of
from mrta_falsify.stack.policy.policy_file import load_policy


class PolicyController:
    """Puts a policy on trial: ``controller: {name: ..., file: my_policy.py}`` in a stack.yaml.

    The shipped stack allocates tasks, grants rooms and plans paths. The policy drives. It must be
    a function of the observation: what it remembers is not copied with the run.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Where the policy is."""

        file: str  #: FILE.py, FILE.py:NAME or FILE.npz, relative to the current directory

    def __init__(self, options: Options) -> None:
        """Load the policy.

        Raises:
            FormatError: there is none in the file.
        """
        self._policy = load_policy(options.file)

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`.

        Raises:
            ValueError: the policy's action has another shape.
        """
        actions = np.zeros((len(view.pose), ACTIONS))
        for robot, seen in enumerate(observe(view)):
            action = np.asarray(self._policy(seen), dtype=np.float64)
            if action.shape != (ACTIONS,):
                raise ValueError(f"the action has shape {action.shape}; it must be ({ACTIONS},)")
            actions[robot] = action
        return on_their_own(twists_of(actions, view))


def on_their_own(twist: Array) -> ControlResult:
    """Report twists ``(N, 3)`` that each robot chose by itself."""
    own = np.arange(len(twist))
    return ControlResult(
        command=Command(twist=twist),
        cluster=own,
        leader=own,
        slack=np.zeros(len(own)),
        fallback=np.zeros(len(own), dtype=np.bool_),
    )
