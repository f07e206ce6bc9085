"""Services and their clients."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from simulator_interface.foreign.ros_nodes.fibres import NS
from simulator_interface.foreign.ros_nodes.futures import Future
from simulator_interface.foreign.ros_nodes.ros_graph import Graph


class Service:
    """Answers requests.

    Args:
        graph: it belongs to.
        srv_type: with ``Request`` and ``Response``.
        name: full.
        callback: called with the request and an empty response; gives the response, or a
            coroutine that does.
        group: of callbacks.
        notify: called when a request has come.
    """

    def __init__(
        self,
        graph: Graph,
        srv_type: Any,
        name: str,
        callback: Callable[[Any, Any], Any],
        *,
        group: Any,
        notify: Callable[[], None],
    ) -> None:
        self.srv_type, self.srv_name, self.callback, self.callback_group = (
            srv_type,
            name,
            callback,
            group,
        )
        self._graph, self._notify = graph, notify
        self._waiting: deque[tuple[Any, Client, Future]] = deque()
        graph.services[name] = self
        graph.changed.set()

    def arrive(self, request: Any, client: Client, future: Future) -> None:
        """Take in a request."""
        self._waiting.append((request, client, future))
        self._notify()

    def is_ready(self) -> bool:
        """Tell whether a request waits."""
        return bool(self._waiting)

    def take(self) -> Callable[[], object]:
        """Give the call that the oldest request makes due."""
        request, client, future = self._waiting.popleft()

        def call() -> Any:
            answer = self.callback(request, self.srv_type.Response())
            if hasattr(answer, "send"):
                return self._later(answer, client, future)
            self._answer(answer, client, future)
            return None

        return call

    def destroy(self) -> None:
        """End it."""
        if self._graph.services.get(self.srv_name) is self:
            del self._graph.services[self.srv_name]

    async def _later(self, answer: Any, client: Client, future: Future) -> None:
        self._answer(await answer, client, future)

    def _answer(self, response: Any, client: Client, future: Future) -> None:
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
        response = response.copied()
        graph = self._graph
        due = graph.timeline.now + graph.latency()
        graph.timeline.at(due, lambda: client.arrive(response, future))


class Client:
    """Asks a service.

    Args:
        graph: it belongs to.
        srv_type: with ``Request`` and ``Response``.
        name: full.
        group: of callbacks.
        node: whose executor hands out responses.
    """

    def __init__(self, graph: Graph, srv_type: Any, name: str, *, group: Any, node: Any) -> None:
        self.srv_type, self.srv_name, self.callback_group = srv_type, name, group
        self._graph, self._node = graph, node
        self._waiting: deque[tuple[Any, Future]] = deque()

    def call_async(self, request: Any) -> Future:
        """Ask; the future is done when an executor has handed out the response.

        Raises:
            TypeError: the request is of another type.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        request, future = request.copied(), Future(executor=self._node.executor)
        graph = self._graph

        def reach() -> None:
            service = graph.services.get(self.srv_name)
            if service is not None:  # else nobody ever answers
                service.arrive(request, self, future)

        graph.timeline.at(graph.timeline.now + graph.latency(), reach)
        return future

    def call(self, request: Any) -> Any:
        """Ask, and wait; another thread must spin, or it waits for ever."""
        future = self.call_async(request)
        future.ended.wait(self._graph.timeline)
        return future.result()

    def service_is_ready(self) -> bool:
        """Tell whether the service is there."""
        return self.srv_name in self._graph.services

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait for the service, at most ``timeout_sec`` [s]; say whether it is there."""
        timeline = self._graph.timeline
        until = None if timeout_sec is None else timeline.now + int(timeout_sec * NS)
        while not self.service_is_ready() and (until is None or timeline.now < until):
            self._graph.changed.clear()
            self._graph.changed.wait(timeline, until)
        return self.service_is_ready()

    def arrive(self, response: Any, future: Future) -> None:
        """Take in a response."""
        self._waiting.append((response, future))
        self._node.notify()

    def is_ready(self) -> bool:
        """Tell whether a response waits."""
        return bool(self._waiting)

    def take(self) -> Callable[[], object]:
        """Give the call that hands out the oldest response."""
        response, future = self._waiting.popleft()
        return lambda: None if future.cancelled() else future.set_result(response)

    def destroy(self) -> None:
        """End it."""


class GuardCondition:
    """Calls back once it was triggered."""

    def __init__(
        self, callback: Callable[[], object], group: Any, notify: Callable[[], None]
    ) -> None:
        self.callback, self.callback_group, self._notify = callback, group, notify
        self._is_triggered = False

    def trigger(self) -> None:
        """Have it call back."""
        self._is_triggered = True
        self._notify()

    def is_ready(self) -> bool:
        """Tell whether it was triggered."""
        return self._is_triggered

    def take(self) -> Callable[[], object]:
        """Give the call that is due."""
        self._is_triggered = False
        return self.callback

    def destroy(self) -> None:
        """End it."""


def full_name(name: str, namespace: str, node: str) -> str:
    """Give the full name of a topic or service: relative, private (``~``) and absolute names."""
    if name.startswith("/"):
        return name
    space = namespace.rstrip("/")
    if name == "~" or name.startswith("~/"):
        return f"{space}/{node}{name[1:]}"
    return f"{space}/{name}"
