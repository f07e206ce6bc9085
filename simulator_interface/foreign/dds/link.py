"""Topics of ROS 2 on DDS: who publishes, who listens, and waiting with a limit.

Data of a topic ``/name`` travel as ``rt/name``. Qualities of service are those that rclcpp gives
its profiles.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic

from simulator_interface.foreign.dds.domains import ANNOUNCING
from simulator_interface.foreign.dds.wire_types import WireTypes
from simulator_interface.foreign.robot_topics import NANO, Topic

BLOCKING = 0.1  # s that a reliable writer may block, as in rclcpp
MAX_TAKEN = 1000  # messages at once
_PLAIN_CDR = Policy.DataRepresentation(use_cdrv0_representation=True)

Handler = Callable[[Any], None]


class Link:
    """A participant of a DDS domain.

    Args:
        domain: its number.
        types: of the messages.
    """

    def __init__(self, domain: int, types: WireTypes) -> None:
        self._types = types
        self._domain = Domain(domain, ANNOUNCING)
        self._participant = DomainParticipant(domain)
        self._waiting = WaitSet(self._participant)
        self._writers: dict[str, DataWriter] = {}
        self._readers: dict[str, tuple[DataReader, Handler]] = {}

    def advertise(self, topic: Topic) -> None:
        """Begin to publish a topic."""
        qos = _qos(topic, keeps_all=False)
        self._writers[topic.name] = DataWriter(
            self._participant, self._dds_topic(topic, qos), qos=qos
        )

    def listen(self, topic: Topic, handle: Handler, *, wakes: bool = True) -> None:
        """Begin to listen to a topic.

        Args:
            topic: which.
            handle: called by :meth:`take` and :meth:`wait` with each message.
            wakes: whether :meth:`wait` ends when a message comes.
        """
        qos = _qos(topic, keeps_all=True)
        reader = DataReader(self._participant, self._dds_topic(topic, qos), qos=qos)
        if wakes:
            unread = SampleState.NotRead | ViewState.Any | InstanceState.Any
            self._waiting.attach(ReadCondition(reader, unread))
        self._readers[topic.name] = reader, handle

    def publish(self, topic: Topic, message: Any) -> None:
        """Publish a message of a topic that is advertised."""
        self._writers[topic.name].write(message)

    def take(self) -> int:
        """Handle all messages that have come, topic by topic; give how many there were."""
        count = 0
        for reader, handle in self._readers.values():
            for message in reader.take(MAX_TAKEN):
                if message.sample_info.valid_data:  # else a writer has left
                    count += 1
                    handle(message)
        return count

    def wait(self, until: float) -> int:
        """Wait for messages and handle them.

        Args:
            until: by the monotonic clock [s].

        Returns:
            How many were handled; 0: it is past ``until``, or a writer has left.
        """
        left = until - time.monotonic()
        if left > 0.0:
            self._waiting.wait(max(1, round(left * NANO)))
        return self.take()

    def listeners(self, name: str) -> int:
        """Count who listens to a topic that is published here."""
        return len(self._writers[name].get_matched_subscriptions())

    def publishers(self, name: str) -> int:
        """Count who publishes a topic that is listened to here."""
        return len(self._readers[name][0].get_matched_publications())

    def matches(self) -> tuple[int, ...]:
        """Count the other ends of all topics; it changes while participants find each other."""
        return (*map(self.listeners, self._writers), *map(self.publishers, self._readers))

    def close(self) -> None:
        """Leave the domain; nothing may be asked afterwards."""
        # Entities go with the last reference to them, children before what they belong to.
        del self._waiting
        self._writers.clear()
        self._readers.clear()
        del self._participant
        del self._domain

    def _dds_topic(self, topic: Topic, qos: Qos) -> DdsTopic:
        return DdsTopic(self._participant, f"rt{topic.name}", self._types.type_of(topic.type), qos)


def _qos(topic: Topic, *, keeps_all: bool) -> Qos:
    """Give the policies of a topic.

    Args:
        topic: which.
        keeps_all: whether nothing that has come may be overwritten unread; it has no part in
            whether two ends match.
    """
    wanted = topic.qos
    # No message may be lost because the other end writes quicker than this one reads.
    history = Policy.History.KeepAll if keeps_all else Policy.History.KeepLast(wanted.depth)
    reliable = Policy.Reliability.Reliable(round(BLOCKING * NANO))
    durable = Policy.Durability.TransientLocal if wanted.is_transient_local else None
    return Qos(
        reliable if wanted.is_reliable else Policy.Reliability.BestEffort,
        durable or Policy.Durability.Volatile,
        history,
        _PLAIN_CDR,
    )
