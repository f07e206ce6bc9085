"""What samplers know of scenes that were looked at without running them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.feedback import DEMANDS, SceneLoads
from mrta_falsify.core.protocols import Preflight
from samplers.asking import STEPS, Mutator, evenly_in_logarithm

KEPT = 4096  # scenes
LEAST_SPREAD = 1e-9  # demands that vary less say nothing
PARENTS = 4  # best scenes that have children
CHILDREN = 8  # that are looked at before parents are chosen anew


class Preflights:
    """Looks at scenes, each once; itself a :class:`~mrta_falsify.core.protocols.Preflight`."""

    @classmethod
    def remembering(cls, preflight: Preflight) -> Preflights:
        """Remember what ``preflight`` tells; what remembers already is shared."""
        return preflight if isinstance(preflight, Preflights) else cls(preflight)

    def __init__(self, preflight: Preflight) -> None:
        self._preflight = preflight
        self._known: OrderedDict[bytes, SceneLoads | None] = OrderedDict()

    def __call__(self, u: Array) -> SceneLoads | None:
        """Look at the scene at ``u`` ``(k,)``."""
        key = np.asarray(u, dtype=np.float64).tobytes()
        if key not in self._known:
            found = self._preflight(u)
            self._known[key] = found
            if found is not None:
                self._known[np.asarray(found.u, dtype=np.float64).tobytes()] = found
            while len(self._known) > KEPT:
                self._known.popitem(last=False)
        self._known.move_to_end(key)
        return self._known[key]

    def of(self, points: Iterable[Array]) -> list[SceneLoads]:
        """Look at the scenes of points ``(k,)``; those without a scene are left out."""
        return [found for found in map(self, points) if found is not None]

    def climb(
        self,
        scenes: Sequence[SceneLoads],
        worth: Callable[[Sequence[SceneLoads]], Array],
        mutator: Mutator,
        *,
        random: np.random.Generator,
        looks: int,
        others: Sequence[SceneLoads] = (),
    ) -> SceneLoads:
        """Look at children of the best scenes, of their children, and so on.

        Args:
            scenes: to begin with, at least one.
            worth: of scenes, ``(n,)``.
            mutator: makes the children.
            random: drawn from.
            looks: children looked at in all.
            others: scenes that may have children, too, but are not sought.

        Returns:
            The best of the scenes and of all children.
        """
        known = [*scenes, *others]
        values = worth(known)
        for begin in range(0, looks, CHILDREN):
            best = np.argsort(-values, kind="stable")[:PARENTS]
            parents = random.choice(best, size=min(CHILDREN, looks - begin))
            children = self.of(
                mutator.child(known[i].u, evenly_in_logarithm(random, *STEPS), random)
                for i in parents
            )
            if children:
                known += children
                values = np.concatenate([values, worth(children)])
        values[len(scenes) : len(scenes) + len(others)] = -np.inf
        return known[int(np.argmax(values))]

    def demands(self, points: Iterable[Array]) -> Array:
        """Measure what points ``(k,)`` ask for, ``(n, m)``; nan where there is no scene."""
        nothing = np.full(len(DEMANDS), np.nan)
        found = [nothing if scene is None else scene.demands for scene in map(self, points)]
        return np.array(found).reshape(-1, len(DEMANDS))


def standardised(demands: Array, among: Array) -> Array:
    """Shift and scale demands ``(n, m)`` to mean 0 and deviation 1 in ``among`` ``(a, m)``.

    What does not vary there, or is not known, is 0.
    """
    known = among[np.isfinite(among).all(axis=1)]
    if not len(known):
        return np.zeros_like(demands)
    spread = known.std(axis=0)
    says = spread > LEAST_SPREAD
    scaled = np.where(says, (demands - known.mean(axis=0)) / np.where(says, spread, 1.0), 0.0)
    return np.where(np.isfinite(scaled), scaled, 0.0)
