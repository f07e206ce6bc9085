"""``rclpy.node.Node``: topics, services, timers and parameters of one node."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from simulator_interface.foreign.ros_nodes import here
from simulator_interface.foreign.ros_nodes.executing import (
    CallbackGroup,
    Executor,
    MutuallyExclusiveCallbackGroup,
)
from simulator_interface.foreign.ros_nodes.fibres import NS
from simulator_interface.foreign.ros_nodes.missing import KNOWN_NODE_NAMES
from simulator_interface.foreign.ros_nodes.quality import profile_of
from simulator_interface.foreign.ros_nodes.ros_graph import Publisher, Subscription
from simulator_interface.foreign.ros_nodes.ros_logging import Logger
from simulator_interface.foreign.ros_nodes.ros_messages import message_class
from simulator_interface.foreign.ros_nodes.ros_parameters import Parameter, Parameters
from simulator_interface.foreign.ros_nodes.ros_services import (
    Client,
    GuardCondition,
    Service,
    full_name,
)
from simulator_interface.foreign.ros_nodes.ros_time import Clock, Rate, ROSClock, Timer


class Node:
    """A node of the user's.

    Args:
        node_name: of it.
        context: of rclpy.
        cli_args: are taken from the program's launch instead.
        namespace: of its names.
        use_global_arguments: whether parameters and remappings of the launch hold.
        parameter_overrides: values that go before those that it declares.
        allow_undeclared_parameters: see :class:`~.ros_parameters.Parameters`.
        automatically_declare_parameters_from_overrides: declares each of them.
        more: takes what is known to do nothing here.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Any = None,
        cli_args: Sequence[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        parameter_overrides: Sequence[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_rosout: bool = True,
        start_parameter_services: bool = True,
        **more: Any,
    ) -> None:
        if more:
            raise NotImplementedError(
                f"the stand-in for rclpy does not support Node({', '.join(more)}=...)"
            )
        self._program = here.program()
        launch = self._program.launch
        self._remappings = dict(launch.remappings) if use_global_arguments else {}
        self._name = self._remappings.get("__node", node_name)
        given = namespace if namespace is not None else launch.namespace
        self._namespace = "/" + self._remappings.get("__ns", given).strip("/")
        self.context = context if context is not None else self._program.context
        self.executor: Executor | None = None
        self._graph = here.graph()
        self._clock = ROSClock()
        self._logger = Logger(self._program, self._name)
        self.default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._timers: list[Timer] = []
        self._subscriptions: list[Subscription] = []
        self._guards: list[GuardCondition] = []
        self._clients: list[Client] = []
        self._services: list[Service] = []
        self._publishers: list[Publisher] = []
        self._waitables: list[Any] = []
        overrides = _of_node(launch.parameters, self._name) if use_global_arguments else {}
        overrides.update({one.name: one.value for one in parameter_overrides or ()})
        self._parameters = Parameters(overrides, allows_undeclared=allow_undeclared_parameters)
        self.declare_parameter("use_sim_time", True, ignore_override=True)
        if automatically_declare_parameters_from_overrides:
            for name, value in overrides.items():
                if name != "use_sim_time":
                    self._parameters.declare(name, value)
        self._program.nodes.append(self)

    # --- who it is -----------------------------------------------------------------------------

    def get_name(self) -> str:
        """Give its name."""
        return self._name

    def get_namespace(self) -> str:
        """Give its namespace."""
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """Give its name with its namespace."""
        return full_name(self._name, self._namespace, self._name)

    def get_logger(self) -> Logger:
        """Give its log."""
        return self._logger

    def get_clock(self) -> Clock:
        """Give its clock."""
        return self._clock

    # --- what executors ask ----------------------------------------------------------------------

    def entities(self) -> list[Any]:
        """List what may have a callback ready, in the order in which they are looked at."""
        return [
            *self._timers,
            *self._subscriptions,
            *self._guards,
            *self._clients,
            *self._services,
            *(entity for waitable in self._waitables for entity in waitable.entities()),
        ]

    def notify(self) -> None:
        """Have the executor look again."""
        if self.executor is not None:
            self.executor.wake()

    def add_waitable(self, waitable: Any) -> None:
        """Have something run by the executor that lists its own entities."""
        self._waitables.append(waitable)

    # --- ends ------------------------------------------------------------------------------------

    def create_publisher(
        self, msg_type: Any, topic: str, qos_profile: Any, *, callback_group: Any = None, **_: Any
    ) -> Publisher:
        """Publish to a topic."""
        qos = profile_of(qos_profile)
        name = self.resolve_topic_name(topic)
        publisher = Publisher(self._graph, msg_type, name, qos, self._logger.warning)
        self._publishers.append(publisher)
        return publisher

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[[Any], object],
        qos_profile: Any,
        *,
        callback_group: CallbackGroup | None = None,
        raw: bool = False,
        **_: Any,
    ) -> Subscription:
        """Subscribe to a topic."""
        if raw:
            raise NotImplementedError(
                "the stand-in for rclpy does not support create_subscription(raw=True)"
            )
        subscription = Subscription(
            self._graph,
            msg_type,
            self.resolve_topic_name(topic),
            callback,
            profile_of(qos_profile),
            group=callback_group or self.default_callback_group,
            notify=self.notify,
            warn=self._logger.warning,
        )
        self._subscriptions.append(subscription)
        self.notify()
        return subscription

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: Any = None,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Offer a service."""
        service = Service(
            self._graph,
            srv_type,
            self.resolve_service_name(srv_name),
            callback,
            group=callback_group or self.default_callback_group,
            notify=self.notify,
        )
        self._services.append(service)
        return service

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: Any = None,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Ask a service."""
        group = callback_group or self.default_callback_group
        name = self.resolve_service_name(srv_name)
        client = Client(self._graph, srv_type, name, group=group, node=self)
        self._clients.append(client)
        return client

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], object],
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
    ) -> Timer:
        """Call back every ``timer_period_sec`` [s]."""
        group = callback_group or self.default_callback_group
        period = int(float(timer_period_sec) * NS)
        timer = Timer(callback, group, period, clock or self._clock, self.notify)
        self._timers.append(timer)
        return timer

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Sleep to a frequency [Hz]."""
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        return Rate(int(NS / frequency), clock or self._clock)

    def create_guard_condition(
        self, callback: Callable[[], object], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Call back when triggered."""
        guard = GuardCondition(callback, callback_group or self.default_callback_group, self.notify)
        self._guards.append(guard)
        return guard

    def destroy_node(self) -> None:
        """End it and all its ends."""
        every: list[list[Any]] = [
            self._timers, self._publishers, self._subscriptions, self._services, self._clients
        ]  # fmt: skip
        for ends in every:
            for end in ends:
                end.destroy()
            ends.clear()
        if self.executor is not None:
            self.executor.remove_node(self)

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """End a publisher."""
        return _destroy(self._publishers, publisher)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """End a subscription."""
        return _destroy(self._subscriptions, subscription)

    def destroy_timer(self, timer: Timer) -> bool:
        """End a timer."""
        return _destroy(self._timers, timer)

    def destroy_client(self, client: Client) -> bool:
        """End a client."""
        return _destroy(self._clients, client)

    def destroy_service(self, service: Service) -> bool:
        """End a service."""
        return _destroy(self._services, service)

    # --- names -----------------------------------------------------------------------------------

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Give the full name of a topic, remapped."""
        full = full_name(topic, self._namespace, self._name)
        if only_expand:
            return full
        for old, new in self._remappings.items():
            if full_name(old, self._namespace, self._name) == full:
                return full_name(new, self._namespace, self._name)
        return full

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Give the full name of a service, remapped."""
        return self.resolve_topic_name(service, only_expand=only_expand)

    def count_publishers(self, topic: str) -> int:
        """Count the publishers of a topic."""
        return self._graph.count_publishers(self.resolve_topic_name(topic))

    def count_subscribers(self, topic: str) -> int:
        """Count the subscriptions to a topic."""
        return self._graph.count_subscribers(self.resolve_topic_name(topic))

    def get_topic_names_and_types(self, no_demangle: bool = False) -> list[tuple[str, list[str]]]:
        """List topics with the names of their types."""
        return self._graph.topics()

    # --- parameters ------------------------------------------------------------------------------

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        """Declare a parameter by its default, or by its type."""
        return self._parameters.declare(name, value, descriptor, ignores=ignore_override)

    def declare_parameters(
        self, namespace: str, parameters: Sequence[Sequence[Any]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare parameters, each ``(name[, value[, descriptor]])``."""
        start = f"{namespace}." if namespace else ""
        return [
            self._parameters.declare(start + one[0], *one[1:3], ignores=ignore_override)
            for one in parameters
        ]

    def has_parameter(self, name: str) -> bool:
        """Tell whether a parameter was declared."""
        return name in self._parameters

    def get_parameter(self, name: str) -> Parameter:
        """Give a parameter."""
        return self._parameters.get(name)

    def get_parameter_or(self, name: str, alternative_value: Any = None) -> Any:
        """Give a parameter, or another value if there is none."""
        return self.get_parameter(name) if name in self._parameters else alternative_value

    def get_parameters(self, names: Sequence[str]) -> list[Parameter]:
        """Give parameters."""
        return [self.get_parameter(name) for name in names]

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Give parameters whose names begin with ``prefix.``."""
        return self._parameters.by_prefix(prefix)

    def set_parameters(self, parameter_list: Sequence[Parameter]) -> list[Any]:
        """Set parameters one by one; give a result for each."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: Sequence[Parameter]) -> Any:
        """Set all of some parameters, or none."""
        refused = self._parameters.set(parameter_list)
        result = message_class("rcl_interfaces/msg/SetParametersResult")
        return result(successful=not refused, reason=refused)

    def add_on_set_parameters_callback(self, callback: Callable[[list[Parameter]], Any]) -> None:
        """Have values checked before they are set."""
        self._parameters.callbacks.insert(0, callback)

    def remove_on_set_parameters_callback(self, callback: Callable[[list[Parameter]], Any]) -> None:
        """Have values checked no longer."""
        self._parameters.callbacks.remove(callback)

    def undeclare_parameter(self, name: str) -> None:
        """Forget a parameter."""
        self._parameters.undeclare(name)

    def __getattr__(self, name: str) -> Any:
        if name in KNOWN_NODE_NAMES:
            raise NotImplementedError(f"the stand-in for rclpy has no Node.{name}")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


def _destroy(ends: list[Any], end: Any) -> bool:
    if end not in ends:
        return False
    ends.remove(end)
    end.destroy()
    return True


def _of_node(parameters: Any, node: str) -> dict[str, Any]:
    """Pick the parameters of one node: its own under its name go before those of all."""
    own = parameters.get(node)
    shared = {name: value for name, value in parameters.items() if not isinstance(value, dict)}
    return {**shared, **(own if isinstance(own, dict) else {})}
