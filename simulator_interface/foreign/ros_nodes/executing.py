"""``rclpy.executors`` and ``rclpy.callback_groups``: who runs the callbacks of a program."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from simulator_interface.foreign.ros_nodes import here
from simulator_interface.foreign.ros_nodes.fibres import NS, Fibre
from simulator_interface.foreign.ros_nodes.futures import Future, Task


class ExternalShutdownException(Exception):  # noqa: N818 - rclpy's name
    """The context was shut down."""


class ShutdownException(Exception):  # noqa: N818 - rclpy's name
    """The executor was shut down."""


ROSInterruptException = ExternalShutdownException  # rclpy's older name


class TimeoutException(Exception):  # noqa: N818 - rclpy's name
    """Nothing was ready in time."""


class CallbackGroup:
    """Says which callbacks may run at the same time."""

    def __init__(self) -> None:
        self.running = 0

    def may_run(self) -> bool:
        """Tell whether one more callback may run."""
        raise NotImplementedError


class ReentrantCallbackGroup(CallbackGroup):
    """Any number may."""

    def may_run(self) -> bool:
        """See :class:`CallbackGroup`."""
        return True


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """One at a time."""

    def may_run(self) -> bool:
        """See :class:`CallbackGroup`."""
        return self.running == 0


class Executor:
    """Runs what is ready, node by node: timers, subscriptions, guards, clients, services.

    Args:
        context: of rclpy.
    """

    most_at_once = 1  #: callbacks

    def __init__(self, *, context: Any = None) -> None:
        self.context = context if context is not None else here.program().context
        self._timeline = here.timeline()
        self._nodes: list[Any] = []
        self._tasks: list[Task] = []
        self._batch: Iterator[Any] = iter(())
        self._may_be_ready = True  # something was heard of since all entities were looked at
        self._waiting: list[Fibre] = []
        self._running = 0
        self._failed: list[BaseException] = []
        self._is_shut_down = False

    # --- nodes and tasks ---------------------------------------------------------------------

    def add_node(self, node: Any) -> bool:
        """Run the callbacks of a node; False: it does already."""
        if node in self._nodes:
            return False
        if node.executor is not None:
            node.executor.remove_node(node)
        self._nodes.append(node)
        node.executor = self
        self.wake()
        return True

    def remove_node(self, node: Any) -> None:
        """Run the callbacks of a node no longer."""
        if node in self._nodes:
            self._nodes.remove(node)
            node.executor = None

    def get_nodes(self) -> list[Any]:
        """List the nodes."""
        return list(self._nodes)

    def create_task(self, callback: Any, *args: Any) -> Task:
        """Have something run, which may be a coroutine."""
        task = Task(callback, args, self)
        self._tasks.append(task)
        self.wake()
        return task

    def wake(self) -> None:
        """Look again at what is ready."""
        self._may_be_ready = True
        for fibre in self._waiting:
            self._timeline.wake(fibre)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """End it."""
        self._is_shut_down = True
        self.wake()
        return True

    # --- spinning ----------------------------------------------------------------------------

    def spin(self) -> None:
        """Run callbacks without end."""
        while self._goes_on():
            self.spin_once()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Run one callback, or wait for it at most ``timeout_sec`` [s]."""
        self._spin(lambda: False, self._deadline(timeout_sec))

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done, at most for ``timeout_sec`` [s]."""
        until = self._deadline(timeout_sec)
        future.add_done_callback(lambda _: self.wake())
        while self._goes_on() and not future.done():
            if until is not None and self._timeline.now >= until:
                return
            self._spin(future.done, until)

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | None = None
    ) -> None:
        """Run one callback, or wait until a future is done."""
        future.add_done_callback(lambda _: self.wake())
        self._spin(future.done, self._deadline(timeout_sec))

    def _deadline(self, timeout_sec: float | None) -> int | None:
        if timeout_sec is None or timeout_sec < 0:
            return None
        return self._timeline.now + int(timeout_sec * NS)

    def _goes_on(self) -> bool:
        return not self._is_shut_down and self.context.ok()

    def _spin(self, is_over: Callable[[], bool], until: int | None) -> None:
        """Run the next callback; wait for it until ``until`` [ns]."""
        has_waited = False
        while self._goes_on() and not is_over():
            if self._failed:
                raise self._failed.pop(0)
            entity = self._next() if self._running < self.most_at_once else None
            if entity is not None:
                self._run(entity)
                return
            if until is not None and self._timeline.now >= until:
                if not has_waited:
                    self._timeline.look_around()
                return
            self._wait(until)
            has_waited = True

    def _wait(self, until: int | None) -> None:
        fibre = self._timeline.fibre()
        self._waiting.append(fibre)
        try:
            self._timeline.park(until)
        finally:
            self._waiting.remove(fibre)

    def _next(self) -> Any:
        """Take the next entity of which a callback is ready and may run; None: there is none."""
        while True:
            for entity in self._batch:
                if entity.is_ready() and _group(entity).may_run():
                    return entity
            if not self._may_be_ready:
                return None
            self._may_be_ready = False
            self._batch = iter([entity for entity in self._entities() if entity.is_ready()])

    def _entities(self) -> list[Any]:
        self._tasks = [task for task in self._tasks if not task.done()]
        return [*self._tasks, *(entity for node in self._nodes for entity in node.entities())]

    def _run(self, entity: Any) -> None:
        call, group = entity.take(), _group(entity)
        group.running += 1
        self._running += 1
        try:
            self._carry_out(call)
        finally:
            self._running -= 1
            group.running -= 1
            self._may_be_ready = True  # more may wait in it, or for its group

    def _carry_out(self, call: Callable[[], object]) -> None:
        result = call()
        if hasattr(result, "send"):
            self.create_task(result)


class SingleThreadedExecutor(Executor):
    """One callback at a time, in the thread that spins."""


class MultiThreadedExecutor(Executor):
    """Each callback in a thread of its own, as far as their groups allow.

    Args:
        num_threads: callbacks at once; None: four.
        context: of rclpy.
    """

    def __init__(self, num_threads: int | None = None, *, context: Any = None) -> None:
        super().__init__(context=context)
        self.most_at_once = num_threads or THREADS

    def _run(self, entity: Any) -> None:
        call, group = entity.take(), _group(entity)
        group.running += 1
        self._running += 1

        def run() -> None:
            try:
                self._carry_out(call)
            except Exception as error:
                self._failed.append(error)
            finally:
                self._running -= 1
                group.running -= 1
                self.wake()

        self._timeline.start(here.program(), run)


THREADS = 4  # of a MultiThreadedExecutor that is told no number; the machine must not decide
_ANY = ReentrantCallbackGroup()


def _group(entity: Any) -> CallbackGroup:
    group = entity.callback_group
    return group if isinstance(group, CallbackGroup) else _ANY
