"""All nodes of a stack: who publishes to whom, who serves whom, and how long messages take."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from simulator_interface.foreign.ros_nodes.fibres import NS, Latch, Timeline
from simulator_interface.foreign.ros_nodes.quality import QoSProfile, what_differs
from simulator_interface.foreign.ros_nodes.schedule import Schedule


class Publisher:
    """One end of a topic.

    Args:
        graph: it belongs to.
        msg_type: of its messages.
        topic: full name.
        qos: quality of service.
        warn: called with what the user should know.
    """

    def __init__(
        self,
        graph: Graph,
        msg_type: Any,
        topic: str,
        qos: QoSProfile,
        warn: Callable[[str], object] = print,
    ) -> None:
        self.msg_type, self.topic_name, self.topic, self.qos_profile = msg_type, topic, topic, qos
        self.warn = warn
        self.kept: deque[Any] = deque(maxlen=qos.most if qos.is_transient_local else 0)
        self.links: list[_Link] = []
        self._graph = graph
        graph.add_publisher(self)

    def publish(self, message: Any) -> None:
        """Send a message to all that subscribe.

        Raises:
            TypeError: it is of another type.
        """
        if not isinstance(message, self.msg_type):
            raise TypeError(f"Expected {self.msg_type}, got {type(message)}")
        if self.kept.maxlen != 0:
            self.kept.append(message.copied())
        for link in self.links:
            link.send(message.copied())

    def get_subscription_count(self) -> int:
        """Count the subscriptions that it reaches."""
        return len(self.links)

    def assert_liveliness(self) -> None:
        """Do nothing."""

    def destroy(self) -> None:
        """End it."""
        self._graph.publishers.remove(self)
        self.links.clear()


class Subscription:
    """The other end of a topic; messages wait in it until its callback takes them.

    Args:
        graph: it belongs to.
        msg_type: of its messages.
        topic: full name.
        callback: is called with each message.
        qos: quality of service.
        group: of callbacks.
        notify: called when a message has come.
        warn: called with what the user should know.
    """

    def __init__(
        self,
        graph: Graph,
        msg_type: Any,
        topic: str,
        callback: Callable[[Any], object],
        qos: QoSProfile,
        *,
        group: Any = None,
        notify: Callable[[], None] = lambda: None,
        warn: Callable[[str], object] = print,
    ) -> None:
        self.msg_type, self.topic_name, self.topic, self.qos_profile = msg_type, topic, topic, qos
        self.callback, self.callback_group, self.notify, self.warn = callback, group, notify, warn
        self.waiting: deque[Any] = deque(maxlen=qos.most)
        self._graph = graph
        graph.add_subscription(self)

    def arrive(self, message: Any) -> None:
        """Take in a message; the oldest one is lost where too many wait."""
        self.waiting.append(message)
        self.notify()

    def is_ready(self) -> bool:
        """Tell whether a message waits."""
        return bool(self.waiting)

    def take(self) -> Callable[[], object]:
        """Give the call that its oldest message makes due."""
        message = self.waiting.popleft()
        return lambda: self.callback(message)

    def get_publisher_count(self) -> int:
        """Count the publishers that reach it."""
        return self._graph.count_publishers(self.topic_name)

    def destroy(self) -> None:
        """End it."""
        self._graph.forget_subscription(self)


class _Link:
    """From a publisher to a subscription; messages do not overtake each other on it."""

    def __init__(self, graph: Graph, subscription: Subscription) -> None:
        self._graph, self.subscription = graph, subscription
        self._last = 0

    def send(self, message: Any) -> None:
        timeline = self._graph.timeline
        self._last = max(self._last, timeline.now + self._graph.latency())
        subscription = self.subscription
        timeline.at(self._last, lambda: subscription.arrive(message))


class Graph:
    """All ends of topics and services.

    Args:
        timeline: it runs on.
        schedule: says how long messages take.
    """

    def __init__(self, timeline: Timeline, schedule: Schedule) -> None:
        self.timeline = timeline
        self.publishers: list[Publisher] = []
        self.subscriptions: list[Subscription] = []
        self.services: dict[str, Any] = {}
        self.changed = Latch()  #: set when something was added
        self._schedule = schedule

    def latency(self) -> int:
        """Draw how long one message takes [ns]."""
        return round(self._schedule.latency() * NS)

    def add_publisher(self, publisher: Publisher) -> None:
        """Connect a publisher with all that subscribe already."""
        self.publishers.append(publisher)
        for subscription in self.subscriptions:
            self._connect(publisher, subscription)
        self.changed.set()

    def add_subscription(self, subscription: Subscription) -> None:
        """Connect a subscription with all that publish already."""
        self.subscriptions.append(subscription)
        for publisher in self.publishers:
            self._connect(publisher, subscription)
        self.changed.set()

    def forget_subscription(self, subscription: Subscription) -> None:
        """Disconnect a subscription."""
        self.subscriptions.remove(subscription)
        for publisher in self.publishers:
            publisher.links = [
                link for link in publisher.links if link.subscription is not subscription
            ]

    def count_publishers(self, topic: str) -> int:
        """Count the publishers of a topic."""
        return sum(publisher.topic == topic for publisher in self.publishers)

    def count_subscribers(self, topic: str) -> int:
        """Count the subscriptions to a topic."""
        return sum(subscription.topic == topic for subscription in self.subscriptions)

    def topics(self) -> list[tuple[str, list[str]]]:
        """List topics with the names of their types."""
        types: dict[str, set[str]] = {}
        ends: list[Any] = [*self.publishers, *self.subscriptions]
        for end in ends:
            types.setdefault(end.topic, set()).add(end.msg_type.TYPE)
        return [(topic, sorted(names)) for topic, names in sorted(types.items())]

    def _connect(self, publisher: Publisher, subscription: Subscription) -> None:
        if publisher.topic != subscription.topic or publisher.msg_type != subscription.msg_type:
            return
        policy = what_differs(publisher.qos_profile, subscription.qos_profile)
        if policy:
            text = f"incompatible QoS on {publisher.topic!r}: {policy}. No messages will be sent"
            publisher.warn(text)
            subscription.warn(text)
            return
        link = _Link(self, subscription)
        publisher.links.append(link)
        if subscription.qos_profile.is_transient_local:
            for message in publisher.kept:
                link.send(message.copied())
