"""A controller whose commands are decided from outside, after it has been asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.policy.observation import twists_of
from mrta_falsify.stack.policy.policy_controller import on_their_own


class AwaitedActions:
    """Answers with a command at rest, which :meth:`act` fills before the frame is used.

    Nothing that a stack says beside the command depends on it. So the frame with the filled
    command is the one that a controller would have made that knew the actions at once.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        del options
        self.view: ControlView | None = None  #: of the last tick
        self._twist = np.zeros((0, 3))

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        self.view, self._twist = view, np.zeros((len(view.pose), 3))
        return on_their_own(self._twist)

    def act(self, actions: Array) -> None:
        """Decide the command of the last tick by ``actions`` ``(N, 2)``."""
        assert self.view is not None, "it was asked"
        self._twist[:] = twists_of(actions, self.view)
