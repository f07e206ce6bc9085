"""The default allocator: insertion, then exact within a limit, then the best subset."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem
from mrta_falsify.core.codec import quantity
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.objective import Objective
from mrta_falsify.stack.allocation.route_search import MAX_TASKS

MAX_PAIRS = 30 * 20  # tasks x robots up to which the exact search is worth its time


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainOptions:
    """What is minimised, and how far the exact search goes."""

    objective: Objective = "completion"
    node_limit: int = quantity(low=0, default=1_000_000)  #: of the exact search; 0: never
    improvement_steps: int = quantity(low=0, high=1_000_000, default=0)
    seed: int = quantity(low=0, default=0)


class Chain:
    """Answers at once where it can, proves where it must, and always says what is lost."""

    Options = ChainOptions

    def __init__(self, options: ChainOptions) -> None:
        self._options = options
        self._insertion = Insertion(
            InsertionOptions(
                objective=options.objective,
                improvement_steps=options.improvement_steps,
                seed=options.seed,
            )
        )

    @property
    def incremental(self) -> Insertion:
        """The insertion that it begins with; its routes may live on from batch to batch."""
        return self._insertion

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        quick = self._insertion.allocate(problem)
        size = len(problem.tasks) * len(problem.robots)
        small = size <= MAX_PAIRS and len(problem.tasks) <= MAX_TASKS
        if quick.status == "plan" or not small or not self._options.node_limit:
            return quick
        exact = Exact(
            ExactOptions(
                node_limit=self._options.node_limit,
                objective=self._options.objective,
                improvement_steps=self._options.improvement_steps,
            )
        )
        slow = exact.allocate(problem)
        return slow if _lost(slow) <= _lost(quick) else quick


def _lost(answer: Allocation) -> int:
    return len(answer.late) + len(answer.unserved)
