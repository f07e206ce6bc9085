"""``rclpy.qos``: policies, profiles, and which of them match."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Any

from simulator_interface.foreign.ros_nodes.ros_time import Duration


class HistoryPolicy(enum.IntEnum):
    """How many messages wait."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(enum.IntEnum):
    """Whether a lost message is sent again."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3


class DurabilityPolicy(enum.IntEnum):
    """Whether who comes late gets the last messages."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3


class LivelinessPolicy(enum.IntEnum):
    """How a publisher is known to live; taken note of only."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4


@dataclass
class QoSProfile:
    """Quality of service of a publisher or a subscription.

    ``deadline``, ``lifespan`` and ``liveliness`` are taken and do nothing.
    """

    depth: int = 10
    history: HistoryPolicy = HistoryPolicy.KEEP_LAST
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE
    lifespan: Duration = field(default_factory=Duration)
    deadline: Duration = field(default_factory=Duration)
    liveliness: LivelinessPolicy = LivelinessPolicy.SYSTEM_DEFAULT
    liveliness_lease_duration: Duration = field(default_factory=Duration)
    avoid_ros_namespace_conventions: bool = False

    @property
    def is_reliable(self) -> bool:
        """Whether each message comes."""
        return self.reliability != ReliabilityPolicy.BEST_EFFORT

    @property
    def is_transient_local(self) -> bool:
        """Whether the last messages are kept for who comes late."""
        return self.durability == DurabilityPolicy.TRANSIENT_LOCAL

    @property
    def most(self) -> int | None:
        """How many messages may wait; None: any number."""
        return None if self.history == HistoryPolicy.KEEP_ALL else max(1, self.depth)


qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
qos_profile_system_default = QoSProfile()
qos_profile_services_default = QoSProfile()
qos_profile_parameters = QoSProfile(depth=1000)
qos_profile_parameter_events = QoSProfile(depth=1000)
qos_profile_action_status_default = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class QoSPresetProfiles(enum.Enum):
    """Profiles by name."""

    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default


def profile_of(given: Any) -> QoSProfile:
    """Convert a queue depth to a quality-of-service profile; a profile stays as it is.

    Raises:
        TypeError: it is neither.
        ValueError: the depth is negative.
    """
    if isinstance(given, QoSPresetProfiles):
        return given.value
    if isinstance(given, QoSProfile):
        return given
    if isinstance(given, bool) or not isinstance(given, int):
        raise TypeError("Expected QoSProfile or int, but received " + repr(type(given)))
    if given < 0:
        raise ValueError("history depth must be greater than or equal to zero")
    return QoSProfile(depth=given)


def what_differs(offered: QoSProfile, wanted: QoSProfile) -> str:
    """Name the policy because of which a subscription gets nothing; empty: they match."""
    if wanted.is_reliable and not offered.is_reliable:
        return "reliability"
    if wanted.is_transient_local and not offered.is_transient_local:
        return "durability"
    return ""


QoSHistoryPolicy, QoSReliabilityPolicy = HistoryPolicy, ReliabilityPolicy  # rclpy's older names
QoSDurabilityPolicy, QoSLivelinessPolicy = DurabilityPolicy, LivelinessPolicy
