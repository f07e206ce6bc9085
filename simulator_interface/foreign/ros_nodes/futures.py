"""``rclpy.task``: futures, and callbacks that are coroutines."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

from simulator_interface.foreign.ros_nodes.fibres import Latch


class Future:
    """A result that will be there.

    Args:
        executor: is called back by; None: callbacks are called at once.
    """

    def __init__(self, *, executor: Any = None) -> None:
        self.ended = Latch()
        self._executor = executor
        self._result: Any = None
        self._exception: BaseException | None = None
        self._is_cancelled = False
        self._callbacks: list[Callable[[Future], object]] = []

    def done(self) -> bool:
        """Tell whether there is a result, an exception, or it was cancelled."""
        return self.ended.is_set

    def cancelled(self) -> bool:
        """Tell whether it was cancelled."""
        return self._is_cancelled

    def result(self) -> Any:
        """Give the result, None while there is none.

        Raises:
            Exception: that was set.
        """
        if self._exception is not None:
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        """Give the exception, if there is one."""
        return self._exception

    def set_result(self, result: Any) -> None:
        """Set the result."""
        self._result = result
        self._end()

    def set_exception(self, exception: BaseException) -> None:
        """Set an exception, which whoever asks for the result gets."""
        self._exception = exception
        self._end()

    def cancel(self) -> None:
        """Give it up."""
        if not self.done():
            self._is_cancelled = True
            self._end()

    def add_done_callback(self, callback: Callable[[Future], object]) -> None:
        """Have something called with this when it is done, at once if it is."""
        if self.done():
            self._call(callback)
        else:
            self._callbacks.append(callback)

    def __await__(self) -> Generator[Future, None, Any]:
        while not self.done():
            yield self
        return self.result()

    def _end(self) -> None:
        if self.done():
            return
        self.ended.set()
        callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            self._call(callback)

    def _call(self, callback: Callable[[Future], object]) -> None:
        if self._executor is not None:
            self._executor.create_task(callback, self)
        else:
            callback(self)


class Task(Future):
    """A call, or a coroutine, that an executor runs bit by bit.

    Args:
        run: called with ``args``; a coroutine that it gives is run to its end.
        executor: to be woken when a bit can be run.
    """

    def __init__(self, run: Any, args: tuple[Any, ...], executor: Any) -> None:
        super().__init__(executor=executor)
        self._run, self._args = run, args
        self._coroutine: Any = run if hasattr(run, "send") else None
        self.callback_group: Any = None
        self._may_go_on = True
        self._wakes = executor

    def is_ready(self) -> bool:
        """Tell whether a bit of it can be run."""
        return self._may_go_on and not self.done()

    def take(self) -> Callable[[], object]:
        """Give the next bit."""
        self._may_go_on = False
        return self._step

    def _step(self) -> None:
        try:
            if self._coroutine is None:
                result = self._run(*self._args)
                if not hasattr(result, "send"):
                    self.set_result(result)
                    return
                self._coroutine = result
            awaited = self._coroutine.send(None)
        except StopIteration as end:
            self.set_result(end.value)
            return
        except Exception as error:
            self.set_exception(error)
            raise
        if isinstance(awaited, Future):
            awaited.add_done_callback(self._go_on)
        else:
            self._go_on(self)

    def _go_on(self, _: Future) -> None:
        self._may_go_on = True
        self._wakes.wake()
